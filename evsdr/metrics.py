"""How far recovered maps are from the truth."""

import numpy as np

from evsdr.records import Maps, Truth


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
