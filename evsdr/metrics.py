"""How far recovered maps are from the truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.records import Maps


@dataclass(frozen=True)
class Truth:
    """What is true of a scene.

    Attributes
    ----------
    normal : (H, W, 3) float
        Unit normals in the camera frame: x right, y up, z toward the camera.
    reflectance : (H, W, n_band) float
        Absolute reflectance per band.
    mask : (H, W) bool
        Pixels that count.
    """

    normal: np.ndarray
    reflectance: np.ndarray
    mask: np.ndarray


def angular_error_deg(normal: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Give the angle between vectors of any length and dimension.

    2 atan2(||u - v||, ||u + v||) of the unit vectors u and v keeps its accuracy at all angles, where arccos
    of the dot product loses it near 0 and 180 (Kahan 2006, "How Futile are Mindless Assessments of Roundoff",
    section 12).

    Parameters
    ----------
    normal, truth : (..., n) float
        Vectors. One that is zero is at 90 degrees to any other, and at 0 to another zero.

    Returns
    -------
    (...) float64
        Angle [deg], 0..180.
    """
    normal, truth = np.asarray(normal, np.float64), np.asarray(truth, np.float64)
    length, true_length = (np.linalg.norm(v, axis=-1, keepdims=True) for v in (normal, truth))
    u, v = normal / np.where(length > 0, length, 1), truth / np.where(true_length > 0, true_length, 1)
    return np.degrees(2 * np.arctan2(np.linalg.norm(u - v, axis=-1), np.linalg.norm(u + v, axis=-1)))


def score(maps: Maps | Truth, truth: Maps | Truth) -> dict[str, float]:
    """Compare maps with the truth over the truth's mask.

    Returns
    -------
    dict
        `mae_deg`, `median_deg`: mean and median angle between normals [deg]; `sam_deg`: mean angle between
        spectra [deg], 90 where one of two is zero; `rmse`: mean over pixels of the root mean square of the
        differences over bands, absolute, without rescaling. These two are left out where the true reflectance is 0
        everywhere: not known.
    """
    mask = truth.mask
    angle = angular_error_deg(maps.normal[mask], truth.normal[mask])
    out = {"mae_deg": float(angle.mean()), "median_deg": float(np.median(angle))}
    reflectance, true_reflectance = (m.reflectance[mask].astype(np.float64) for m in (maps, truth))
    if true_reflectance.any():
        difference = np.sqrt(np.mean((reflectance - true_reflectance) ** 2, axis=-1))
        out["sam_deg"] = float(angular_error_deg(reflectance, true_reflectance).mean())
        out["rmse"] = float(difference.mean())
    return out


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
    try:
        with open(path, "rb") as stream:
            file = np.load(stream, allow_pickle=False)
            arrays = {name: file[name] for name in shapes if name in file.keys()}
    except Exception as error:  # NumPy, zipfile and zlib raise ten kinds on damage
        raise InputError(f"{path}: this is not a readable .npz archive; write it by numpy.savez.") from error
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
