"""How unknown thresholds are distributed over the pixels, by expectation maximisation."""

import drjit as dr
import numpy as np

from evsdr.solve import triangles
from evsdr.solve.law import MEDIAN_OF_SQUARE

# Of the logarithm of unknown thresholds, before the pixels tell: of the mean, and over the pixels. With 0.3 of the latter thresholds
# take up gloss, and of a sculpture of experiments.table1 half of the contrast (29 degrees; 2.4 with 0.1)
MEAN_SIGMA, FIRST_SIGMA = (0.3, 0.3), (0.1, 0.1)
SMALLEST_SPREAD = 0.003  # of the logarithm over the pixels: less is one value for all
MOVING_SPREAD = 0.03  # the least of that until the mean is found: less would hold it
# More is gloss, or no contrast at all. Guessed: 0.2 each way; an EVK4 has 0.05, v2e by default 0.15
LARGEST_VARIANCE = 0.04
SAMPLE = 4000  # pixels that tell
CURVED_SIGMA = (
    20.0  # of what curvature does to a logarithm, beside itself; measured: -15 on balls and a bumpy mesh
)
LEAST_INFORMATION = 1e-2  # of a pixel: rounding can make it negative
N_HALVED = 20  # intervals of the variance's logarithm: to 1e-5 of it


def first_spread(Float: type, found: tuple | None = None) -> list:
    """Give the distribution to start from: two centres and two standard deviations, as opaque arrays."""
    return [dr.opaque(Float, value) for value in found or (0.0, 0.0, *FIRST_SIGMA)]


def learn_spread(
    theta: list,
    gradient: list,
    matrix: list,
    spread: list,
    curved: np.ndarray | None = None,
    least: float = SMALLEST_SPREAD,
) -> list:
    """Learn mean and spread of the log thresholds over the pixels, from what the data alone say of each.

    Where the distribution pulls hard, what the data say shows in moves far smaller than those at which a descent ends. So
    each pixel first makes the step that its gradient still asks for. Where a surface is curved within a pixel the model is
    not right; what such pixels say is off by a share of the curvature, which is found with the mean.

    Parameters
    ----------
    theta : list of Float
        Unknowns, the logarithms of both factors last.
    gradient, matrix : list of Float
        Of each pixel's cost, and the lower triangle of its Gauss-Newton matrix, with the pull of `spread` in both.
    spread : list of Float
        The distribution so far.
    curved : (n_pixel,) float, optional
        How curved the surface is within each pixel: the square of `model.illumination.pixel_horizon`.
    least : float
        Smallest standard deviation.
    """
    some = slice(None, None, max(1, dr.width(theta[0]) // SAMPLE))
    centre, sigma = np.array([float(value[0]) for value in spread]).reshape(2, 2)
    gains = np.stack([t.numpy()[some] for t in theta[-2:]], axis=-1).astype(float)
    slope = np.stack([g.numpy()[some] for g in gradient], axis=-1).astype(float)
    covariance = triangles.inverse_of(triangles.block(matrix, range(len(theta)), some))[:, -2:]
    off = gains - np.einsum("nij,nj->ni", covariance, slope) - centre
    posterior = covariance[:, :, -2:]
    curved = np.zeros(dr.width(theta[0])) if curved is None else np.broadcast_to(curved, dr.width(theta[0]))
    move, left = _mean(off, posterior, sigma, curved[some])
    sigma = np.sqrt(_variance(off, posterior, sigma, least) + left)
    return [dr.opaque(type(theta[0]), float(v)) for v in (*(centre + move), *sigma)]


def _mean(
    off: np.ndarray, posterior: np.ndarray, sigma: np.ndarray, curved: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Give the mean (2,) of both logarithms, and its variances, from those of pixels (n, 2), posterior (n, 2, 2).

    What the data say of both together is common to them: the contrast of a pixel. Least squares with two means, and two
    slopes by how `curved` (n,) pixels are.
    """
    before = np.linalg.inv(posterior)
    value, vector = np.linalg.eigh(before - np.diag(sigma**-2.0))
    alone = np.einsum("nij,nj,nkj->nik", vector, 1 / np.maximum(value, LEAST_INFORMATION), vector)
    alone_off = np.einsum("nij,njk,nk->ni", alone, before, off)
    variance = alone + np.diag(sigma**2)
    away = np.abs(alone_off - np.median(alone_off, axis=0))
    kept = (away < 3 * np.sqrt(np.einsum("nii->ni", variance))).all(axis=1)
    weight, curved = np.linalg.inv(variance[kept]), curved[kept]
    powers = np.stack([np.ones_like(curved), curved, curved**2])[[[0, 1], [1, 2]]]
    total = np.einsum("abn,nij->aibj", powers, weight).reshape(4, 4)
    total += np.diag(np.concatenate([np.square(MEAN_SIGMA), [CURVED_SIGMA**2] * 2]) ** -1.0)
    right = np.einsum("an,nij,nj->ai", powers[0], weight, alone_off[kept]).ravel()
    covariance = np.linalg.inv(total)  # a few pixels tell little
    return (covariance @ right)[:2], np.diagonal(covariance)[:2]


def _variance(off: np.ndarray, posterior: np.ndarray, sigma: np.ndarray, least: float) -> np.ndarray:
    """Give the variance (2,) of each over the pixels, as its data show it with the other at its mean.

    That with which deviations are as large as they should be: the median of their squares, each by its own variance. Where
    some pixels know little, as dark ones, the median of all squares is far below what the median of all variances makes.
    """
    posterior = np.einsum("nii->ni", posterior)
    alone = 1 / np.maximum(1 / posterior - sigma**-2.0, LEAST_INFORMATION)
    off = off * alone / posterior
    weight = 1 / (alone + sigma**2)
    near = np.abs(off - np.median(off, axis=0)) < 3 / np.sqrt(weight)
    weight *= near | ~near.any(axis=0)  # two camps have none near the middle
    square = (off - np.average(off, axis=0, weights=weight)) ** 2
    low, high = np.full((2, 2), [[least**2], [LARGEST_VARIANCE]])
    for _ in range(N_HALVED):
        middle = np.sqrt(low * high)
        wide = np.median(square / (alone + middle), axis=0) > MEDIAN_OF_SQUARE
        low, high = np.where(wide, middle, low), np.where(wide, high, middle)
    return middle
