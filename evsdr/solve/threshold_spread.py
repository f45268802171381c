"""How unknown thresholds are distributed over the pixels, by expectation maximisation."""

import drjit as dr
import numpy as np

from evsdr.solve import triangles

FIRST_SIGMA = (0.3, 0.3)  # of the logarithm of unknown thresholds, before the pixels tell
SMALLEST_SPREAD = 0.003  # of the logarithm over the pixels: less is one value for all
MOVING_SPREAD = 0.03  # the least of that until the mean is found: less would hold it
LARGEST_VARIANCE = 0.25
SAMPLE = 4000  # pixels that tell
MEDIAN_OF_SQUARE = 0.455  # of a standard normal variable


def first_spread(Float: type, found: tuple | None = None) -> list:
    """Give the distribution to start from: two centres and two standard deviations, as opaque arrays."""
    return [dr.opaque(Float, value) for value in found or (0.0, 0.0, *FIRST_SIGMA)]


def learn_spread(theta: list, matrix: list, spread: list, least: float = SMALLEST_SPREAD) -> list:
    """Learn mean and spread of the log thresholds over the pixels, from what the data alone say of each.

    Parameters
    ----------
    theta : list of Float
        Unknowns, the logarithms of both factors last.
    matrix : list of Float
        Lower triangle of each pixel's Gauss-Newton matrix, with the pull of `spread` in it.
    spread : list of Float
        The distribution so far.
    least : float
        Smallest standard deviation.
    """
    n = len(theta)
    some = slice(None, None, max(1, dr.width(theta[0]) // SAMPLE))
    centre, sigma = np.array([float(value[0]) for value in spread]).reshape(2, 2, 1)
    gains = np.stack([t.numpy()[some] for t in theta[-2:]]).astype(float)
    covariance = np.linalg.inv(triangles.block(matrix, range(n), some))
    posterior = np.diagonal(covariance, axis1=1, axis2=2)[:, -2:].T
    # variance without the distribution's pull
    alone = 1 / np.maximum(1 / posterior - 1 / sigma**2, 1e-2)
    gains = centre + (gains - centre) * alone / posterior
    weight = 1 / (alone + sigma**2)
    weight *= np.abs(gains - np.median(gains, axis=1, keepdims=True)) < 3 / np.sqrt(weight)
    total = np.sum(weight, axis=1) + 1 / np.square(FIRST_SIGMA)  # a few pixels tell little
    centre = np.sum(weight * gains, axis=1) / total
    off = np.median((gains - centre[:, None]) ** 2, axis=1) / MEDIAN_OF_SQUARE
    variance = np.clip(off - np.median(alone, axis=1), least**2, LARGEST_VARIANCE)
    sigma = np.sqrt(variance + 1 / total)
    return [dr.opaque(type(theta[0]), float(v)) for v in (*centre, *sigma)]
