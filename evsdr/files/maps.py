"""Read maps.npz, what a fit has recovered."""

from dataclasses import MISSING, fields
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.arrays import read_npz
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
