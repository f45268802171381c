"""What pixels tell of each other: priors whose strength the data decide.

- normal: second differences of its x and y are small. Student's t, so that edges stay.
- integrable: slopes are those of a surface, so that their sum around four pixels is 0. Student's t, since
  surfaces may be torn.
- reflectance: second differences of its logarithm are small. Student's t with a full covariance between the
  bands, so that a texture of one colour counts once.
- spectra: reflectances lie near few directions, see `spectra`.

Gauss-Newton steps on all pixels together find the largest posterior; each is solved by conjugate gradients,
preconditioned pixel by pixel. Between steps, expectation maximisation learns the scales (`scatter`). Random
draws from the posterior around its maximum give the standard deviations (Papandreou and Yuille 2010, Gaussian
sampling by local perturbations).
"""

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import numpy as np
from scipy import ndimage

from evsdr.solve import triangles
from evsdr.solve.grid import Grid
from evsdr.solve.neighbours.spectra import learn_spectra
from evsdr.solve.neighbours.stencils import differences, edge_weights
from evsdr.solve.neighbours.student import learn_scatter, update_scatter
from evsdr.solve.neighbours.system import (
    joint_solver,
    joint_system,
    perturbation,
    prior_gradient,
    with_spectra,
)

PARTS = ("normal", "integrable", "reflectance", "spectra")
N_LEARN = 2000  # pixels that teach
SHARPEST = 0.2  # smallest scale of a prior, relative to the noise of single pixels
LARGEST_MOVE = 1.0  # of an unknown per Gauss-Newton step
SLACK = 1.0  # log likelihood that a pixel may lose beyond what a step predicts
POOL = 5  # width of the window over which draws are averaged [pixels]


@dataclass(frozen=True)
class Priors:
    """Which priors count, and how long to look.

    Attributes
    ----------
    parts : tuple of str
        Of `PARTS`.
    n_round : int
        Gauss-Newton steps.
    n_draw : int
        Random draws.
    seed : int
        Of the draws.
    """

    parts: tuple = PARTS
    n_round: int = 6
    n_draw: int = 8
    seed: int = 0


@dataclass(frozen=True)
class Posterior:
    """What data and priors say together.

    Attributes
    ----------
    theta : list of Float, (n_unknown)
        Unknowns where the posterior is largest.
    covariance : (n_pixel, n_unknown, n_unknown) float64
        Of each pixel's unknowns.
    scale : dict of str to float
        Typical second difference of the normal, sum of slopes around a square times n_z^2, and second
        difference of log reflectance; rank of the spectra. Only of priors that count.
    """

    theta: list
    covariance: np.ndarray
    scale: dict


def find_posterior(
    theta: list,
    terms_at: Callable,
    grid: Grid,
    n_band: int,
    priors: Priors,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Posterior:
    """Let pixels learn from each other.

    Parameters
    ----------
    theta : list of Float, (n_unknown)
        Unknowns as single pixels know them: slopes, log reflectances, others that no prior here touches.
    terms_at : callable (theta) -> (cost, gradient, matrix)
        Terms of the data, as `event_terms.normal_equations` gives them.
    grid : Grid
        Neighbours.
    n_band : int
        Number of bands.
    priors : Priors
        Which priors count.
    """
    Float = type(theta[0])
    rng = np.random.default_rng(priors.seed)
    sample = rng.permutation(dr.width(theta[0]))[:N_LEARN]
    data = terms_at(theta)
    inverse = _invert(data[2])
    scatter, floor = {}, {}
    for part in (name for name in priors.parts if name != "spectra"):
        z, noise = differences(part, theta, inverse, grid, n_band, sample)
        if len(z):
            floor[part] = SHARPEST**2 * np.diag(np.median(np.diagonal(noise, axis1=1, axis2=2), axis=0))
            scatter[part] = learn_scatter(z, noise, floor[part], about_zero=True)[1]
    spectra = None
    if "spectra" in priors.parts:
        log_r = np.stack([t.numpy()[sample] for t in theta[2 : 2 + n_band]], axis=-1).astype(float)
        r, noise = np.exp(log_r), triangles.block(inverse, range(2, 2 + n_band), sample)
        spectra = learn_spectra(r, noise * r[:, :, None] * r[:, None, :])
    damping = dr.zeros(Float, dr.width(theta[0]))
    solve_jointly = joint_solver(grid)
    for round_ in range(priors.n_round + 1):
        weights = edge_weights(theta, inverse, scatter, grid, n_band)
        gradient, matrix = with_spectra(theta, data, inverse, spectra, n_band)
        system = joint_system(theta, matrix, damping, weights, scatter, grid, n_band)
        if round_ == priors.n_round:
            break
        pull = prior_gradient(theta, system, grid, n_band)
        step = solve_jointly(system, [-g - k for g, k in zip(gradient, pull)])
        move = [dr.clip(s, -LARGEST_MOVE, LARGEST_MOVE) for s in step]
        trial = [t + m for t, m in zip(theta, move)]
        dr.eval(trial)
        new = terms_at(trial)
        curved = triangles.multiply(data[2], move)
        expected = sum(m * (g + 0.5 * c) for m, g, c in zip(move, data[1], curved))
        good = new[0] - data[0] <= dr.maximum(2 * expected, 0) + SLACK
        damping = dr.select(good, damping * 0.25, dr.maximum(damping * 6, 0.5))
        damping = dr.select(damping < 0.01, 0, damping)
        theta = [dr.select(good, a, b) for a, b in zip(trial, theta)]
        data = tuple(_select(good, a, b) for a, b in zip(new, data))
        dr.eval(theta, data, damping)
        inverse = system["inverse"]
        for part in scatter:
            z, left = differences(part, theta, inverse, grid, n_band, sample)
            scatter[part] = update_scatter(z, left, scatter[part], floor[part])
        progress("neighbours", (round_ + 1) / (priors.n_round + 1))
    system = joint_system(theta, matrix, dr.zeros_like(damping), weights, scatter, grid, n_band)
    n = len(theta)
    single = triangles.block(system["inverse"], range(n), slice(None))
    variance = np.diagonal(single, axis1=1, axis2=2)
    ratio = np.zeros_like(variance)
    for draw in range(priors.n_draw):
        right = perturbation(rng, system, scatter, grid, n_band)
        x = np.stack([v.numpy() for v in solve_jointly(system, right)], axis=-1)
        ratio += np.square(x, dtype=float) / variance / priors.n_draw
        progress("draws", (draw + 1) / priors.n_draw)
    factor = np.sqrt(_pool(ratio, grid.mask)) if priors.n_draw else np.ones_like(ratio)
    factor[:, :2] = np.sqrt(np.mean(factor[:, :2] ** 2, axis=1, keepdims=True))
    covariance = single * factor[:, :, None] * factor[:, None, :]
    scale = {part: float(np.sqrt(np.trace(s) / len(s))) for part, s in sorted(scatter.items())}
    if spectra:
        scale["rank"] = spectra.rank
    return Posterior(theta, covariance, scale)


def _invert(triangle: list) -> list:
    out = triangles.invert(*triangles.factor(triangle))
    dr.eval(out)
    return out


def _select(mask, a, b):
    if isinstance(a, (list, tuple)):
        return [dr.select(mask, x, y) for x, y in zip(a, b)]
    return dr.select(mask, a, b)


def _pool(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Average (n_pixel, n) over windows of the image."""
    weight = ndimage.uniform_filter(mask.astype(float), POOL)[mask]
    out = np.empty_like(values)
    for i, column in enumerate(values.T):
        image = np.zeros(mask.shape)
        image[mask] = column
        out[:, i] = ndimage.uniform_filter(image, POOL)[mask] / weight
    return out
