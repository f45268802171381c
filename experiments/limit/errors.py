"""Errors beside what limits them, and beside what the maps say of them."""

import numpy as np

import evsdr
from evsdr import Maps, Truth, angular_error_deg
from evsdr.limits.bound import Limit

# Limits up to which a pixel counts: where errors are small, and add up to root mean squares
KNOWN_DEG, KNOWN = 10.0, 0.1
# Medians of |error| / standard deviation: of Gaussian errors, and of the angle of those in two dimensions
HALF, HALF_ANGLE = 0.6745, np.sqrt(np.log(2))


def compare(maps: Maps, truth: Truth, limit: Limit) -> dict:
    """Compare maps with truth and limit.

    Returns
    -------
    dict
        `angle` [deg], `reflectance`: root mean squares of errors over the pixels whose normal can be known within
        KNOWN_DEG, or whose reflectance within KNOWN in all bands; `..._known`: their share; `..._bound`, `..._told`:
        root mean squares of the limits over them, with what pixels share unknown and told; `..._ratio`: error over the
        first of these; `..._typical`: the median of each pixel's own ratio, over that of Gaussian errors; None where no
        pixel is known. And the metrics of `score` over all of the truth's pixels.
    """
    figures = evsdr.score(maps, truth)
    unknown, told = limit.unknown, limit.told
    angle = angular_error_deg(maps.normal, truth.normal)
    for name, error, bound, told_bound, known, half in (
        ("angle", angle, unknown.normal_sigma_deg, told.normal_sigma_deg, KNOWN_DEG, HALF_ANGLE),
        (
            "reflectance",
            np.abs(maps.reflectance - truth.reflectance),
            unknown.reflectance_sigma,
            told.reflectance_sigma,
            KNOWN,
            HALF,
        ),
    ):
        good = bound < known
        good = truth.mask & (good if good.ndim == 2 else good.all(axis=-1))
        some = bool(good.any())
        mine, least, told_least = (
            float(np.sqrt(np.mean(v[good] ** 2))) if some else None for v in (error, bound, told_bound)
        )
        figures |= {
            f"{name}_known": np.count_nonzero(good) / np.count_nonzero(truth.mask),
            name: mine,
            f"{name}_bound": least,
            f"{name}_told": told_least,
            f"{name}_ratio": mine / least if some else None,
            f"{name}_typical": float(np.median(error[good] / bound[good]) / half) if some else None,
        }
    return figures


def shares_within(maps: Maps, truth: Truth) -> dict:
    """Tell how often the truth lies within one and two sigma, over known pixels of the truth [share].

    Returns
    -------
    dict
        `angle_1`, `angle_2` for normals, `reflectance_1`, `reflectance_2` for reflectance, each band by itself,
        and `known`, the share of pixels that the maps know; None where they know none.
    """
    known = maps.mask & truth.mask
    angle = angular_error_deg(maps.normal, truth.normal)[known] / maps.normal_sigma_deg[known]
    reflectance = (np.abs(maps.reflectance - truth.reflectance) / maps.reflectance_sigma)[known]
    shares = {"known": np.count_nonzero(known) / np.count_nonzero(truth.mask)}
    for name, value in (("angle", angle), ("reflectance", reflectance)):
        shares |= {f"{name}_{k}": float(np.mean(value < k)) if known.any() else None for k in (1, 2)}
    return shares
