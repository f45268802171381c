"""truth.npz: what maps are compared with."""

from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.arrays import read_npz
from evsdr.records import Truth


def write_truth(path: str | Path, truth: Truth) -> None:
    """Write truth.npz with `normal`, `reflectance` and `mask`."""
    np.savez(path, normal=truth.normal, reflectance=truth.reflectance, mask=truth.mask)


def read_truth(path: str | Path, height: int, width: int, n_band: int) -> Truth:
    """Read truth.npz with `normal`, `reflectance` and `mask`.

    Raises
    ------
    InputError
        The file is missing or damaged, or its arrays don't fit the recording and the scene.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; name a truth.npz.")
    shapes = {"normal": (height, width, 3), "reflectance": (height, width, n_band), "mask": (height, width)}
    arrays = read_npz(path, shapes, "write it by numpy.savez")
    for name, shape in shapes.items():
        if name not in arrays:
            raise InputError(f"{path}: the array {name} is missing; store it with shape {shape}.")
        if arrays[name].shape != shape or arrays[name].dtype.kind not in "fiub":
            raise InputError(
                f"{path}: {name} is an array of {arrays[name].dtype} with shape {arrays[name].shape}; "
                f"store numbers with shape {shape}, as events and scene have it."
            )
    mask = arrays["mask"] != 0
    if not mask.any():
        raise InputError(f"{path}: mask selects no pixel; set it where the truth is known.")
    for name in ("normal", "reflectance"):
        if not np.isfinite(arrays[name][mask]).all():
            raise InputError(f"{path}: {name} is not finite at some pixel of the mask; take it out.")
    if np.abs(np.linalg.norm(arrays["normal"][mask], axis=-1) - 1).max() > 0.01:
        raise InputError(f"{path}: normal has not unit length at some pixel of the mask; normalise it.")
    if arrays["normal"][mask][:, 2].mean() < 0:
        raise InputError(f"{path}: normal points away from the camera; store x right, y up, z toward it.")
    return Truth(arrays["normal"], arrays["reflectance"], mask)
