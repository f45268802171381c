"""ENVI cubes: reflectance and its standard deviation, with wavelengths."""

from pathlib import Path

import numpy as np

from evsdr.exports.source import Source, library

UNKNOWN = -1.0  # `data ignore value`


def write_envi(folder: Path, source: Source) -> None:
    """Write `reflectance.hdr`, `reflectance_sigma.hdr` and their `.img`: float32, by bands; -1 where nothing is known."""
    maps = source.maps
    wavelength = [f"{nm:.6g}" for nm in maps.band_wavelength_nm]
    about = {
        "wavelength": wavelength,
        "wavelength units": "Nanometers",
        "data ignore value": UNKNOWN,
        "band names": [f"{nm} nm" for nm in wavelength],
    }
    for name in ("reflectance", "reflectance_sigma"):
        cube = np.where(maps.mask[..., None], getattr(maps, name), np.float32(UNKNOWN))
        said = about | {"description": f"{name.replace('_', ', ')} of evsdr.fit"}
        save = library("spectral.io.envi").save_image
        save(
            str(folder / f"{name}.hdr"), cube, dtype=np.float32, interleave="bsq", byteorder=0, metadata=said
        )
