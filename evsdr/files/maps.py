"""Read maps.npz, what a fit has recovered."""

from pathlib import Path

import numpy as np

from evsdr.errors import InputError
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
    names = list(Maps.__dataclass_fields__)
    try:
        with open(path, "rb") as stream:
            file = np.load(stream, allow_pickle=False)
            maps = Maps(**{name: file[name] for name in names})
        height, width = maps.mask.shape
        right = maps.normal.shape == (height, width, 3)
        right &= maps.reflectance.shape == (height, width, len(maps.band_wavelength_nm))
    except Exception as error:  # NumPy, zipfile and zlib raise ten kinds on damage
        raise InputError(f"{path}: not a maps.npz with {', '.join(names)}; write it by evsdr.fit.") from error
    if not right or not all(np.isfinite(getattr(maps, name)).all() for name in names):
        raise InputError(
            f"{path}: its arrays have other shapes than evsdr.fit writes, or are not finite; fit again."
        )
    return maps
