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

from evsdr import ldl
from evsdr.grid import AROUND_P, AROUND_Q, SECOND_X, SECOND_Y, SQUARE_MEAN, Grid
from evsdr.scatter import FREEDOM, learn_scatter, update_scatter
from evsdr.spectra import learn_spectra

PARTS = ("normal", "integrable", "reflectance", "spectra")
DIRECTIONS = (SECOND_X, SECOND_Y)
N_LEARN = 2000  # pixels that teach
SHARPEST = 0.2  # smallest scale of a prior, relative to the noise of single pixels
TOLERANCE, MOST_STEPS, LOOK = 0.01, 100, 5  # of the conjugate gradients; steps between two looks
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
    for part in set(priors.parts) - {"spectra"}:
        z, noise = _differences(part, theta, inverse, grid, n_band, sample)
        if len(z):
            floor[part] = SHARPEST**2 * np.diag(np.median(np.diagonal(noise, axis1=1, axis2=2), axis=0))
            scatter[part] = learn_scatter(z, noise, floor[part], about_zero=True)[1]
    spectra = None
    if "spectra" in priors.parts:
        log_r = np.stack([t.numpy()[sample] for t in theta[2 : 2 + n_band]], axis=-1).astype(float)
        r, noise = np.exp(log_r), _block(inverse, range(2, 2 + n_band), sample)
        spectra = learn_spectra(r, noise * r[:, :, None] * r[:, None, :])
    damping = dr.zeros(Float, dr.width(theta[0]))
    conjugate_gradients = _conjugate_gradients(grid)
    for round_ in range(priors.n_round + 1):
        weights = _weights(theta, inverse, scatter, grid, n_band)
        gradient, matrix = _with_spectra(theta, data, inverse, spectra, n_band)
        system = _system(theta, matrix, damping, weights, scatter, grid, n_band)
        if round_ == priors.n_round:
            break
        pull = _prior_gradient(theta, system, grid, n_band)
        step = conjugate_gradients(system, [-g - k for g, k in zip(gradient, pull)])
        move = [dr.clip(s, -LARGEST_MOVE, LARGEST_MOVE) for s in step]
        trial = [t + m for t, m in zip(theta, move)]
        dr.eval(trial)
        new = terms_at(trial)
        curved = ldl.multiply(data[2], move)
        expected = sum(m * (g + 0.5 * c) for m, g, c in zip(move, data[1], curved))
        good = new[0] - data[0] <= dr.maximum(2 * expected, 0) + SLACK
        damping = dr.select(good, damping * 0.25, dr.maximum(damping * 6, 0.5))
        damping = dr.select(damping < 0.01, 0, damping)
        theta = [dr.select(good, a, b) for a, b in zip(trial, theta)]
        data = tuple(_select(good, a, b) for a, b in zip(new, data))
        dr.eval(theta, data, damping)
        inverse = system["inverse"]
        for part in scatter:
            z, left = _differences(part, theta, inverse, grid, n_band, sample)
            scatter[part] = update_scatter(z, left, scatter[part], floor[part])
        progress("neighbours", (round_ + 1) / (priors.n_round + 1))
    system = _system(theta, matrix, dr.zeros_like(damping), weights, scatter, grid, n_band)
    n = len(theta)
    single = _block(system["inverse"], range(n), slice(None))
    variance = np.diagonal(single, axis1=1, axis2=2)
    ratio = np.zeros_like(variance)
    for draw in range(priors.n_draw):
        right = _perturbation(rng, system, scatter, grid, n_band)
        x = np.stack([v.numpy() for v in conjugate_gradients(system, right)], axis=-1)
        ratio += np.square(x, dtype=float) / variance / priors.n_draw
        progress("draws", (draw + 1) / priors.n_draw)
    factor = np.sqrt(_pool(ratio, grid.mask)) if priors.n_draw else np.ones_like(ratio)
    factor[:, :2] = np.sqrt(np.mean(factor[:, :2] ** 2, axis=1, keepdims=True))
    covariance = single * factor[:, :, None] * factor[:, None, :]
    scale = {part: float(np.sqrt(np.trace(s) / len(s))) for part, s in sorted(scatter.items())}
    if spectra:
        scale["rank"] = spectra.rank
    return Posterior(theta, covariance, scale)


# ---------------------------------------------------------------------- differences and their weights


def _normal_xy(theta: list) -> list:
    inv = dr.rsqrt(1.0 + dr.square(theta[0]) + dr.square(theta[1]))
    out = [-theta[0] * inv, -theta[1] * inv]
    dr.eval(out)
    return out


def _normal_jacobian(theta: list) -> list:
    """Derivative of n_x, n_y by the slopes, symmetric: xx, xy, yy."""
    p, q = theta[:2]
    inv = dr.rsqrt(1.0 + p * p + q * q)
    cube = inv * inv * inv
    return [p * p * cube - inv, p * q * cube, q * q * cube - inv]


def _steepness(theta: list, grid: Grid):
    """n_z^2, mean over a square of pixels: weighs slopes, which grow without bounds where normals don't."""
    square = dr.rcp(1.0 + dr.square(theta[0]) + dr.square(theta[1]))
    dr.eval(square)
    return SQUARE_MEAN.apply(grid, square)


def _parts_of(part: str, theta: list, grid: Grid, n_band: int) -> list[list]:
    """Give the differences that a prior wants small: one list of components for each direction."""
    if part == "normal":
        normal = _normal_xy(theta)
        return [[s.apply(grid, n) for n in normal] for s in DIRECTIONS]
    if part == "reflectance":
        return [[s.apply(grid, t) for t in theta[2 : 2 + n_band]] for s in DIRECTIONS]
    around = AROUND_P.apply(grid, theta[0]) + AROUND_Q.apply(grid, theta[1])
    return [[around * _steepness(theta, grid)]]


def _valid(part: str, grid: Grid) -> list:
    return [s.valid(grid) for s in ((SQUARE_MEAN,) if part == "integrable" else DIRECTIONS)]


def _differences(part, theta, inverse, grid, n_band, sample) -> tuple[np.ndarray, np.ndarray]:
    """Give differences (n, d) at some pixels, and their covariances (n, d, d) if pixels are independent."""
    values, noises = [], []
    for components, valid in zip(_parts_of(part, theta, grid, n_band), _valid(part, grid)):
        some = sample[valid.numpy()[sample]]
        values.append(np.stack([c.numpy()[some] for c in components], axis=-1).astype(float))
        if part == "normal":
            a, b, c = (j.numpy()[some].astype(float) for j in _normal_jacobian(theta))
            jacobian = np.stack([a, b, b, c], axis=-1).reshape(-1, 2, 2)
            noises.append(6 * jacobian @ _block(inverse, range(2), some) @ jacobian)
        elif part == "reflectance":
            noises.append(6 * _block(inverse, range(2, 2 + n_band), some))
        else:
            square = _block(inverse, range(2), some)
            steep = _steepness(theta, grid).numpy()[some].astype(float)
            noises.append((np.trace(square, axis1=1, axis2=2) * steep**2)[:, None, None])
    return np.concatenate(values), np.concatenate(noises)


def _weights(theta, inverse, scatter, grid, n_band) -> dict:
    """Give for each prior and direction the weight of Student's t; 0 where there is no difference."""
    out = {}
    for part, spread in scatter.items():
        precision = np.linalg.inv(spread)
        if part == "normal":
            variance = _traced(precision, _turned(inverse, _normal_jacobian(theta)))
        elif part == "reflectance":
            variance = _traced(precision, _rows(inverse, range(2, 2 + n_band)))
        else:
            square = inverse[0] + inverse[2]
            variance = float(precision[0, 0]) * square
        dr.eval(variance)
        d = len(spread)
        out[part] = []
        stencils = (SQUARE_MEAN,) if part == "integrable" else DIRECTIONS
        for components, stencil in zip(_parts_of(part, theta, grid, n_band), stencils):
            around = stencil.squared().apply(grid, variance)
            if part == "integrable":
                around = (
                    around * 4 * dr.square(_steepness(theta, grid))
                )  # squares of the halves, not of the quarters
            distance = _quadratic(precision, components) + around
            weight = (FREEDOM + d) / (FREEDOM + distance)
            out[part].append(dr.select(stencil.valid(grid), weight, 0.0))
    dr.eval(out)
    return out


# ---------------------------------------------------------------------- linear system


def _with_spectra(theta, data, inverse, spectra, n_band) -> tuple[list, list]:
    """Add the prior on spectra to gradient and matrix."""
    gradient, matrix = list(data[1]), list(data[2])
    if spectra is None:
        return gradient, matrix
    r = [dr.exp(t) for t in theta[2 : 2 + n_band]]
    off = [value - float(mean) for value, mean in zip(r, spectra.mean)]
    noise = _rows(inverse, range(2, 2 + n_band))
    noise = [[noise[i][j] * r[i] * r[j] for j in range(n_band)] for i in range(n_band)]
    distance = _quadratic(spectra.precision, off) + _traced(spectra.precision, noise)
    weight = (FREEDOM + n_band) / (FREEDOM + distance)
    for i in range(n_band):
        row = [float(v) for v in spectra.precision[i]]
        gradient[2 + i] = gradient[2 + i] + weight * r[i] * sum(v * o for v, o in zip(row, off))
        for j in range(i + 1):
            at = _place(2 + i, 2 + j)
            matrix[at] = matrix[at] + weight * row[j] * r[i] * r[j]
    dr.eval(gradient, matrix)
    return gradient, matrix


def _system(theta, matrix, damping, weights, scatter, grid, n_band) -> dict:
    """Collect what the product with the matrix of all pixels needs, and its preconditioner."""
    Float = type(theta[0])
    n = len(theta)
    matrix = list(matrix)
    for i in range(n):
        matrix[_place(i, i)] = matrix[_place(i, i)] * (1.0 + damping)
    system = {"matrix": matrix}
    block = list(matrix)
    if "normal" in weights:
        precision = np.linalg.inv(scatter["normal"])
        jacobian = _normal_jacobian(theta)
        around = _around(weights["normal"], grid)
        inner = [[around * float(v) for v in row] for row in precision]
        turned = _sandwich(jacobian, inner)
        for i, j in ((0, 0), (1, 0), (1, 1)):
            block[_place(i, j)] = block[_place(i, j)] + turned[i][j]
        system["jacobian"] = jacobian
        system["normal_precision"] = [[dr.opaque(Float, float(v)) for v in row] for row in precision]
        system["normal"] = weights["normal"]
    if "integrable" in weights:
        square = (
            weights["integrable"][0] * dr.square(_steepness(theta, grid)) / float(scatter["integrable"][0, 0])
        )
        dr.eval(square)
        for i, stencil in enumerate((AROUND_P, AROUND_Q)):
            block[_place(i, i)] = block[_place(i, i)] + stencil.squared().adjoint(grid, square)
        system["square"] = square
    if "reflectance" in weights:
        precision = np.linalg.inv(scatter["reflectance"])
        around = _around(weights["reflectance"], grid)
        for i in range(n_band):
            for j in range(i + 1):
                at = _place(2 + i, 2 + j)
                block[at] = block[at] + around * float(precision[i, j])
        system["precision"] = [[dr.opaque(Float, float(v)) for v in row] for row in precision]
        system["reflectance"] = weights["reflectance"]
    lower, pivot = ldl.factor(block)
    system["lower"], system["pivot"] = lower, pivot
    system["inverse"] = ldl.invert(lower, pivot)
    dr.eval(system)
    return system


def _around(weights: list, grid: Grid):
    """Sum over the differences that a pixel takes part in: squared factor times weight."""
    return sum(s.squared().adjoint(grid, w) for s, w in zip(DIRECTIONS, weights))


def _prior_product(v: list, normal: list, system: dict, grid: Grid, n_band: int) -> list:
    """Apply the matrix of the smooth and integrable priors to slopes and log reflectances v.

    `normal` holds what v means for n_x and n_y. All are evaluated arrays.
    """
    ends = {}
    if "normal" in system:
        ends["normal"] = [
            [w * s.apply(grid, u) for u in normal] for s, w in zip(DIRECTIONS, system["normal"])
        ]
    if "square" in system:
        ends["square"] = system["square"] * (AROUND_P.apply(grid, v[0]) + AROUND_Q.apply(grid, v[1]))
    if "reflectance" in system:
        ends["reflectance"] = [
            [w * s.apply(grid, u) for u in v[2 : 2 + n_band]]
            for s, w in zip(DIRECTIONS, system["reflectance"])
        ]
    dr.eval(ends)
    return _prior_adjoint(ends, system, grid, n_band, len(v))


def _prior_adjoint(ends: dict, system: dict, grid: Grid, n_band: int, n: int) -> list:
    """Carry differences back to the unknowns."""
    out = [0.0] * n
    if "normal" in ends:
        back = [sum(s.adjoint(grid, e[i]) for s, e in zip(DIRECTIONS, ends["normal"])) for i in range(2)]
        back = [sum(v * b for v, b in zip(row, back)) for row in system["normal_precision"]]
        xx, xy, yy = system["jacobian"]
        out[0] += xx * back[0] + xy * back[1]
        out[1] += xy * back[0] + yy * back[1]
    if "square" in ends:
        out[0] += AROUND_P.adjoint(grid, ends["square"])
        out[1] += AROUND_Q.adjoint(grid, ends["square"])
    if "reflectance" in ends:
        back = [
            sum(s.adjoint(grid, e[i]) for s, e in zip(DIRECTIONS, ends["reflectance"])) for i in range(n_band)
        ]
        for i, row in enumerate(system["precision"]):
            out[2 + i] += sum(v * b for v, b in zip(row, back))
    return out


def _prior_gradient(theta, system, grid, n_band) -> list:
    return _prior_product(theta, _normal_xy(theta), system, grid, n_band)


def _perturbation(rng, system, scatter, grid, n_band) -> list:
    """Draw a right-hand side whose solution is a draw from the posterior."""
    Float = type(system["pivot"][0])
    n, n_pixel = len(system["pivot"]), dr.width(system["pivot"][0])

    def white(count):
        return [Float(row) for row in rng.standard_normal((count, n_pixel), np.float32)]

    right = ldl.color(*ldl.factor(system["matrix"]), white(n))
    ends = {}
    for part, d in (("normal", 2), ("reflectance", n_band)):
        if part in system:
            root = np.linalg.cholesky(scatter[part])  # precision times this is a root of the precision
            ends[part] = []
            for w in system[part]:
                noise = white(d)
                ends[part].append(
                    [dr.sqrt(w) * sum(float(v) * e for v, e in zip(row, noise)) for row in root]
                )
    if "square" in system:
        ends["square"] = dr.sqrt(system["square"]) * white(1)[0]
    dr.eval(ends)
    return [r + k for r, k in zip(right, _prior_adjoint(ends, system, grid, n_band, n))]


def _conjugate_gradients(grid: Grid) -> Callable:
    """Make a solver of systems of all pixels."""

    @dr.freeze
    def begin(system, right):
        z = ldl.solve(system["lower"], system["pivot"], right)
        return z, dr.sum(sum(r * s for r, s in zip(right, z)))

    @dr.freeze(state_fn=lambda *_: (grid.index, grid.exists))
    def step(system, x, r, p, rho):
        n_band = len(system["precision"]) if "precision" in system else 0
        normal = []
        if "jacobian" in system:
            xx, xy, yy = system["jacobian"]
            normal = [xx * p[0] + xy * p[1], xy * p[0] + yy * p[1]]
            dr.eval(normal)
        prior = _prior_product(p, normal, system, grid, n_band)
        q = [a + b for a, b in zip(ldl.multiply(system["matrix"], p), prior)]
        curvature = dr.sum(sum(a * b for a, b in zip(p, q)))
        dr.eval(q, curvature)
        alpha = rho / dr.maximum(curvature, 1e-30)
        x = [a + alpha * b for a, b in zip(x, p)]
        r = [a - alpha * b for a, b in zip(r, q)]
        z = ldl.solve(system["lower"], system["pivot"], r)
        new_rho = dr.sum(sum(a * b for a, b in zip(r, z)))
        dr.eval(x, r, z, new_rho)
        beta = new_rho / dr.maximum(rho, 1e-30)
        p = [a + beta * b for a, b in zip(z, p)]
        return x, r, p, new_rho

    def solve(system, right):
        system = {k: v for k, v in system.items() if k != "inverse"}
        r = list(right)
        dr.eval(r)
        p, rho = begin(system, r)
        first = float(rho[0])
        x = [dr.zeros(type(v), dr.width(v)) for v in r]
        dr.make_opaque(x)
        for i in range(MOST_STEPS):
            x, r, p, rho = step(system, x, r, p, rho)
            dr.eval(x, r, p, rho)
            if i % LOOK == LOOK - 1 and float(rho[0]) <= TOLERANCE**2 * first:
                break
        return x

    return solve


# ---------------------------------------------------------------------- small helpers


def _place(i: int, j: int) -> int:
    """Place of entry (i, j) in a lower triangle."""
    return max(i, j) * (max(i, j) + 1) // 2 + min(i, j)


def _rows(triangle: list, which) -> list[list]:
    return [[triangle[_place(i, j)] for j in which] for i in which]


def _invert(triangle: list) -> list:
    out = ldl.invert(*ldl.factor(triangle))
    dr.eval(out)
    return out


def _block(triangle: list, which, some) -> np.ndarray:
    """Give a block of the matrices of some pixels (n, d, d)."""
    rows = _rows(triangle, which)
    return np.stack([np.stack([v.numpy()[some] for v in row], axis=-1) for row in rows], axis=-2).astype(
        float
    )


def _sandwich(jacobian: list, inner: list[list]) -> list[list]:
    """J M J for symmetric J (xx, xy, yy)."""
    j = [[jacobian[0], jacobian[1]], [jacobian[1], jacobian[2]]]
    half = [[sum(j[i][k] * inner[k][m] for k in range(2)) for m in range(2)] for i in range(2)]
    return [[sum(half[i][k] * j[k][m] for k in range(2)) for m in range(2)] for i in range(2)]


def _turned(inverse: list, jacobian: list) -> list[list]:
    return _sandwich(jacobian, _rows(inverse, range(2)))


def _quadratic(precision: np.ndarray, z: list):
    return sum(float(precision[i, j]) * z[i] * z[j] for i in range(len(z)) for j in range(len(z)))


def _traced(precision: np.ndarray, rows: list[list]):
    return sum(float(precision[i, j]) * rows[i][j] for i in range(len(rows)) for j in range(len(rows)))


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
