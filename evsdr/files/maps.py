"""Read what a fit has recovered."""

import hashlib
from dataclasses import MISSING, fields
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.arrays import read_npz
from evsdr.files.json_text import read_json
from evsdr.records import Maps


def read_maps(path: Path) -> Maps:
    """Read a maps.npz.

    Raises
    ------
    InputError
        The file is missing or damaged, or its arrays don't fit each other.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; name a maps.npz of evsdr.fit.")
    names = [field.name for field in fields(Maps) if field.default is MISSING]
    arrays = read_npz(path, [field.name for field in fields(Maps)], "write it by evsdr.fit")
    numbers = all(array.dtype.kind in "fiub" for array in arrays.values())
    if (
        not set(names) <= set(arrays)
        or not numbers
        or arrays["mask"].ndim != 2
        or arrays["band_wavelength_nm"].ndim != 1
    ):
        raise InputError(f"{path}: not a maps.npz with {', '.join(names)}; write it by evsdr.fit.")
    size, n_band = arrays["mask"].shape, len(arrays["band_wavelength_nm"])
    deep = {"normal": (3,), "reflectance": (n_band,), "reflectance_sigma": (n_band,)}
    shapes = {name: (*size, *deep.get(name, ())) for name in arrays} | {"band_wavelength_nm": (n_band,)}
    if any(arrays[name].shape != shapes[name] or not np.isfinite(arrays[name]).all() for name in arrays):
        raise InputError(
            f"{path}: its arrays have other shapes than evsdr.fit writes, or are not finite; fit again."
        )
    return Maps(**arrays)


def read_results(folder: str | Path) -> tuple[Maps, dict]:
    """Read the maps and the summary of a fit, and check that all its files are as they were written.

    Parameters
    ----------
    folder : str or Path
        Results of `python -m evsdr.fit`, or of `Fit.save`.

    Raises
    ------
    InputError
        A file is missing, damaged, or not of this fit.
    """
    folder = Path(folder)
    path = folder / "summary.json"
    summary = read_json(path, "the folder of a fit that has ended")
    files = summary.get("files") if isinstance(summary, dict) else None
    if not isinstance(files, dict) or "maps.npz" not in files:
        raise InputError(f"{path}: it names no files; name the folder of a fit, or fit again.")
    for name, told in files.items():
        file = folder / Path(name).name
        if not file.is_file():
            raise InputError(f"{file}: there is no such file, but {path} names it; fit again.")
        if sha256(file) != told:
            raise InputError(f"{file}: this is not the file that {path} tells of; fit again.")
    return read_maps(folder / "maps.npz"), summary


def sha256(path: Path) -> str:
    """Give the SHA-256 of a file, in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
