"""Write what was recovered: arrays, float images, images to look at, and a summary."""

import json
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import OpenEXR
import png

from evsdr.files.atomic import atomic_folder
from evsdr.files.daylight import reflectance_to_srgb
from evsdr.files.maps import sha256
from evsdr.records import Maps


def write_results(
    folder: str | Path, maps: Maps, summary: dict, more: dict[str, Callable[[Path], None]] | None = None
) -> None:
    """Write maps and summary into a folder, all files or none.

    `maps.npz`, `normal.exr`, `reflectance.exr`, `normal.png`, `reflectance.png`, `summary.json`.

    Parameters
    ----------
    folder : str or Path
        Made if missing; files of these names are replaced.
    maps : Maps
        Finite everywhere.
    summary : dict
        Numbers (NumPy's too), texts, lists and dicts of them, without NaN or infinity. What is written gets another key,
        `files`: the SHA-256 of each other file.
    more : dict of callable (path), optional
        Further files by name, each with what writes it.

    Raises
    ------
    InputError
        The folder can't be written.
    ValueError
        A map or a number of the summary is not finite.
    """
    arrays = {field.name: np.asarray(getattr(maps, field.name)) for field in fields(maps)}
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite everywhere")
    json.dumps(summary, allow_nan=False, default=_plain)  # raises before anything is written
    with atomic_folder(folder, "summary.json") as temporary:
        np.savez(temporary / "maps.npz", **arrays)
        write_exr(temporary / "normal.exr", {"RGB": maps.normal})
        names = spectral_channels(maps.band_wavelength_nm)
        bands = {name: maps.reflectance[..., b] for b, name in enumerate(names)}
        write_exr(temporary / "reflectance.exr", bands, spectralLayoutVersion="1.0")
        write_png(temporary / "normal.png", encode_normal(maps.normal, maps.mask))
        colour = reflectance_to_srgb(maps.reflectance, maps.band_wavelength_nm)
        colour = np.where(maps.mask[..., None], np.round(255 * colour), 0)
        write_png(temporary / "reflectance.png", colour.astype(np.uint8))
        for name, write in (more or {}).items():
            write(temporary / name)
        files = {file.name: sha256(file) for file in sorted(temporary.iterdir())}
        text = json.dumps(summary | {"files": files}, indent=2, allow_nan=False, default=_plain)
        (temporary / "summary.json").write_text(text + "\n", encoding="utf-8")


def _plain(value: object) -> object:
    """Make Python numbers and lists of NumPy's."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no place in a summary")


def spectral_channels(wavelength_nm: np.ndarray) -> list[str]:
    """Name the EXR channels of reflectance bands, "T.405,000000nm".

    Layout of Fichet, Pacanowski and Wilkie 2021, "An OpenEXR Layout for Spectral Images", JCGT 10(3).

    Parameters
    ----------
    wavelength_nm : (n_band,) float
        Centroids [nm]. Bands that share one are moved up in steps of 1e-6 nm, as names must differ.

    Returns
    -------
    list of str, (n_band,)
    """
    names: list[str] = []
    for micro in (round(1e6 * float(nm)) for nm in wavelength_nm):
        while (name := f"T.{micro // 10**6},{micro % 10**6:06d}nm") in names:
            micro += 1
        names.append(name)
    return names


def encode_normal(normal: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Encode normals as 16-bit colours, (n + 1) / 2 with green up (the OpenGL convention).

    Parameters
    ----------
    normal : (H, W, 3) float
        Unit normals in the camera frame.
    mask : (H, W) bool
        Elsewhere the normal (0, 0, 1) is written.

    Returns
    -------
    (H, W, 3) uint16
    """
    shown = np.where(mask[..., None], normal, (0.0, 0.0, 1.0))
    return np.round(65535 * (np.clip(shown, -1, 1) + 1) / 2).astype(np.uint16)


def write_exr(path: Path, channels: dict[str, np.ndarray], **attributes: str) -> None:
    """Write a float EXR with the given channels and header attributes; raises OSError."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    pixels = {name: np.ascontiguousarray(channel, np.float32) for name, channel in channels.items()}
    try:
        OpenEXR.File(header, pixels).write(str(path))
    except RuntimeError as error:
        raise OSError(str(error)) from error


def write_png(path: Path, image: np.ndarray) -> None:
    """Write an (H, W, 3) RGB image of uint8 or uint16."""
    height, width, _ = image.shape
    rows = (row.tobytes() for row in image.astype(image.dtype.newbyteorder(">")))
    with open(path, "wb") as file:
        png.Writer(width, height, greyscale=False, bitdepth=8 * image.itemsize).write_packed(file, rows)
