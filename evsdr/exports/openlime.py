"""A bundle for OpenLIME: what it needs to light the object anew, and its bands with their wavelengths.

File names, `info.json` and channels are those of OpenLIME's layers `brdf` and `multispectral` in the layout `image`. The
viewer itself is not part of it: `index.html` looks for it beside itself.
"""

import json
from pathlib import Path

import numpy as np

from evsdr.exports.source import Source, library
from evsdr.files.daylight import daylight_weights, reflectance_to_srgb
from evsdr.files.results import write_png

PER_PICTURE = 3  # bands
MOST_BANDS = 33  # that OpenLIME shows
NULL_NORMAL = 128  # a normal of no length: OpenLIME shows nothing there
PAGE = Path(__file__).with_name("openlime.html")


def write_openlime(folder: Path, source: Source) -> None:
    """Write `index.html`, `colour.png`, `normals.png`, `info.json`, `presets.json` and `bands_NN.jpg`.

    Eight bits: `tiff` and `envi` have all. Bands are linear, three to a picture, clipped to 0..1; the first 33.
    """
    maps, mask = source.maps, source.maps.mask[..., None]
    nm = maps.band_wavelength_nm[:MOST_BANDS]
    height, width = maps.mask.shape
    colour = _bytes(np.where(mask, reflectance_to_srgb(maps.reflectance, maps.band_wavelength_nm), 0))
    write_png(folder / "colour.png", colour)
    write_png(folder / "normals.png", np.where(mask, _bytes((maps.normal + 1) / 2), np.uint8(NULL_NORMAL)))
    n_picture = -(-len(nm) // PER_PICTURE)
    bands = np.zeros((height, width, PER_PICTURE * n_picture), np.uint8)
    bands[..., : len(nm)] = _bytes(np.where(mask, maps.reflectance[..., : len(nm)], 0))
    for k in range(n_picture):
        picture = library("PIL.Image").fromarray(bands[..., PER_PICTURE * k : PER_PICTURE * (k + 1)])
        picture.save(
            folder / f"bands_{k:02d}.jpg", quality=100, subsampling=0
        )  # OpenLIME asks for this suffix
    info = {
        "basename": "bands",
        "width": width,
        "height": height,
        "nplanes": len(nm),
        "nimg": n_picture,
        "wavelength": [float(f"{value:.6g}") for value in nm],
        "wavelength_unit": "nm",
    }
    if source.pixel_mm:
        info["pixelSizeInMM"] = source.pixel_mm
    weights = daylight_weights(nm)
    presets = {"Daylight": {name: weights[:, k].tolist() for k, name in enumerate(("red", "green", "blue"))}}
    (folder / "info.json").write_text(json.dumps(info, indent=2) + "\n", encoding="utf-8")
    (folder / "presets.json").write_text(json.dumps(presets, indent=2) + "\n", encoding="utf-8")
    (folder / "index.html").write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")


def _bytes(value: np.ndarray) -> np.ndarray:
    """Bring 0..1 to bytes."""
    return np.round(255 * np.clip(value, 0, 1)).astype(np.uint8)
