"""Float TIFFs: one for each map, bands as samples, what is unknown by GDAL's tag."""

import json
from pathlib import Path

import numpy as np

from evsdr.exports.source import Source, library

NO_DATA = 42113  # GDAL_NODATA, an ASCII tag


def write_tiff(folder: Path, source: Source) -> None:
    """Write `normal`, `reflectance`, their sigmas and `depth` as `.tif`: NaN where nothing is known.

    The description of each tells its unit or wavelengths, as JSON.
    """
    maps = source.maps
    bands = {"wavelength_nm": [float(nm) for nm in maps.band_wavelength_nm]}
    images = {
        "normal": (maps.normal, {"frame": "camera: x right, y up, z toward the camera"}),
        "normal_sigma_deg": (maps.normal_sigma_deg, {"unit": "degree"}),
        "reflectance": (maps.reflectance, bands),
        "reflectance_sigma": (maps.reflectance_sigma, bands),
        "depth": (-source.points[..., 2], {"unit": source.unit}),
    }
    for name, (image, about) in images.items():
        image = np.where(maps.mask[..., None], np.atleast_3d(image), np.nan).astype(np.float32)
        _write(folder / f"{name}.tif", np.moveaxis(image, 2, 0), {"map": name} | about)


def _write(path: Path, planes: np.ndarray, about: dict) -> None:
    """Write planes (n, H, W) as the samples of one picture."""
    one = len(planes) == 1
    library("tifffile").imwrite(
        path,
        planes[0] if one else planes,
        photometric="minisblack",
        planarconfig=None if one else "separate",
        compression="zlib",
        metadata=None,
        description=json.dumps(about),
        extratags=[(NO_DATA, 2, None, "nan", True)],
    )
