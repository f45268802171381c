"""Per-pixel Levenberg-Marquardt on event pairs, with starts offered by neighbouring pixels.

Unknowns of a pixel: two slopes and the log reflectance of each band. All pixels step together in Dr.Jit
arrays; each has its own damping and accepts or rejects its own step. The forward model is a callable; nothing
here knows Mitsuba.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import drjit as dr
import numpy as np
from scipy import ndimage

from evsdr.frozen import no_garbage_collection
from evsdr.model.illumination import pixel_horizon
from evsdr.solve import triangles
from evsdr.solve.effort import PRESETS, Effort  # noqa: F401
from evsdr.solve.grid import NEXT, Grid
from evsdr.solve.loss import (
    derivative_table,
    gaussian_share,
    normal_equations,
    relative_residual,
    silence_equations,
)
from evsdr.solve.neighbours.posterior import find_posterior
from evsdr.solve.pair_data import PairData, signal_table, thin, without

SLOPE_SIGMA = 5.0  # weak prior: a slope of 5 is a surface seen at 79 degrees
REFLECTANCE_CENTRE, LOG_REFLECTANCE_SIGMA = 0.25, 2.0  # weak prior: 0.03 .. 2 within one sigma
LARGEST_STEP = (1.0, 2.0)  # of a slope, of a log reflectance
FIRST_THRESHOLD_SIGMA = (0.3, 0.3)  # of the log of unknown thresholds, before the pixels tell
SAMPLE = 4000  # pixels that tell how thresholds are distributed
FIRED_LOWER = (
    1.0  # an event's own threshold is this times noise^2 below the mean: lower ones are reached first
)
SMALLEST_SPREAD = 0.003  # of the log of thresholds over the pixels: less is one value for all
MOVING_SPREAD = 0.03  # the least of that until the mean is found: less would hold it
NOISE_RANGE = (0.005, 1.0)  # of the relative residual
WIDER = 1.5  # width of the Cauchy cost where thresholds are unknown: the tails of the residuals tell of them
N_SHOWN = 32  # pairs of a pixel that show its noise
MISFIT, IGNORED = (
    3.0,
    100.0,
)  # noise of a pixel, relative to most, that the model doesn't explain; what it gets then
LARGEST_SLOPE, LOG_REFLECTANCE_RANGE = 30.0, (-9.0, 1.5)


@dataclass(frozen=True)
class Solution:
    """What the solver found.

    Attributes
    ----------
    theta : (n_pixel, 2 + n_band) float32
        Slopes and log reflectances.
    covariance : (n_pixel, 2 + n_band, 2 + n_band) float64
        Inverse of the Gauss-Newton matrix.
    cost : (n_pixel,) float32
        Robust cost, prior included.
    noise : float
        Standard deviation of the relative residual in most pixels, measured.
    noise_factor : (n_pixel,) float32
        How much larger it is in each pixel; `IGNORED` where the model explains little.
    n_step : int
        Steps made.
    threshold_gain : (n_pixel, 2) float32, optional
        Estimated factors on the told C_on and C_off.
    threshold_gain_sigma : (n_pixel, 2) float32, optional
        One standard deviation of each, relative.
    threshold_prior : tuple of 4 float, optional
        How the logarithms of the factors are distributed over the pixels: two centres, two standard deviations.
    prior_scale : dict
        Scales of the priors that counted, see `priors.Posterior`.
    """

    theta: np.ndarray
    covariance: np.ndarray
    cost: np.ndarray
    noise: float
    noise_factor: np.ndarray
    n_step: int
    threshold_gain: np.ndarray | None = None
    threshold_gain_sigma: np.ndarray | None = None
    threshold_prior: tuple | None = None
    prior_scale: dict = field(default_factory=dict)


@no_garbage_collection()
def solve(
    model: Callable,
    pairs: PairData,
    constant_light,
    start: list,
    grid: Grid,
    effort: Effort,
    progress: Callable[[str, float], None] = lambda stage, share: None,
    threshold_prior: tuple | None = None,
) -> Solution:
    """Fit slopes and reflectances to event pairs.

    Parameters
    ----------
    model : callable (p, q, reflectance, softness) -> (signal, by_p, by_q[, diffuse])
        Forward model, such as `shading.LambertianRing` or `gloss.GlossyRing`: a PyTree of Dr.Jit arrays with the
        bands of the LEDs in `illumination.band`; gives lists over LEDs. `diffuse` is the part of the signal that
        scales with the reflectance, all by default.
    pairs : PairData
        Event pairs.
    constant_light : Float
        C_w.
    start : list of Float, (2 + n_band), or two more
        Start values: slopes and log reflectances. Two more make the pixel's thresholds unknown: the logarithms
        of the factors on C_on and C_off. How these are distributed over the pixels is found by expectation
        maximisation, so both a wrong told value and a fixed pattern are corrected.
    grid : Grid
        Neighbours of each pixel: it tries their solutions, and learns from them.
    effort : Effort
        How hard to try.
    progress : callable (stage, share)
        Told what is done, share 0..1.
    threshold_prior : tuple of 4 float, optional
        What an earlier solution found of the thresholds' distribution; kept if `effort` has no `n_expectation`.

    Returns
    -------
    Solution
    """
    Float, UInt32 = type(start[0]), type(pairs.offset)
    n_unknown = len(start)
    n_pixel = dr.opaque(UInt32, dr.width(start[0]))
    n_band, hard = model.illumination.n_band, model.illumination.horizon
    thresholds = n_unknown > 2 + n_band
    prior_centre = [0.0, 0.0] + [float(np.log(REFLECTANCE_CENTRE))] * n_band
    prior_sigma = [SLOPE_SIGMA] * 2 + [LOG_REFLECTANCE_SIGMA] * n_band
    distributed = threshold_prior or (0.0, 0.0, *FIRST_THRESHOLD_SIGMA)
    hyper = [dr.opaque(Float, value) for value in distributed] if thresholds else []

    robust = effort.robust * (WIDER if thresholds else 1)
    slope_term = gaussian_share(robust)
    if effort.n_most:
        pairs = thin(pairs, effort.n_most)
    few = heard = thin(pairs, effort.n_pair)  # enough until the last steps
    freeze = dr.freeze(state_fn=lambda *_: (model, heard, few, constant_light, n_pixel))

    def at_thresholds(pairs, theta):
        """The pairs with the thresholds of theta, if it has any."""
        if not thresholds:
            return pairs
        on, off = pairs.threshold_on * dr.exp(theta[-2]), pairs.threshold_off * dr.exp(theta[-1])
        return replace(pairs, threshold_on=on, threshold_off=off)

    def evaluate(theta, softness, noise, fine, hyper):
        """Cost, gradient and matrix, prior included."""
        reflectance = [dr.exp(t) for t in theta[2 : 2 + n_band]]
        signal, by_p, by_q, *diffuse = model(theta[0], theta[1], reflectance, softness)
        table = derivative_table(signal, by_p, by_q, model.illumination.band, dr.width(theta[0]), *diffuse)
        given = (
            table,
            at_thresholds(heard, theta),
            constant_light,
            n_pixel,
            n_band,
            noise,
            robust,
            thresholds,
        )
        cost, gradient, matrix = normal_equations(*given, slope_term if fine else 0.0)
        if fine and effort.silence:
            silent_cost, silent_gradient, silent_matrix = silence_equations(*given)
            cost += silent_cost
            gradient = [a + b for a, b in zip(gradient, silent_gradient)]
            matrix = [a + b for a, b in zip(matrix, silent_matrix)]
        centres, sigmas = prior_centre + hyper[:2], prior_sigma + hyper[2:]
        for i, (t, centre, sigma) in enumerate(zip(theta, centres, sigmas)):
            z = (t - centre) / sigma
            cost += 0.5 * dr.square(z)
            gradient[i] += z / sigma
            matrix[i * (i + 3) // 2] += 1.0 / (sigma * sigma)
        return [cost, *gradient, *matrix]

    @freeze
    def begin(theta, softness, noise, fine, hyper):
        return evaluate(theta, softness, noise, fine, hyper)

    @freeze
    def step(theta, terms, damping, softness, noise, fine, hyper):
        """One Levenberg-Marquardt step; each pixel keeps what lowers its own cost."""
        gradient, matrix = terms[1 : 1 + n_unknown], terms[1 + n_unknown :]
        move = triangles.solve(*triangles.factor(matrix, damping), [-g for g in gradient])
        trial = []
        for i, (t, m) in enumerate(zip(theta, move)):
            limit = LARGEST_STEP[0 if i < 2 else 1]
            low, high = (-LARGEST_SLOPE, LARGEST_SLOPE) if i < 2 else LOG_REFLECTANCE_RANGE
            trial.append(dr.clip(t + dr.clip(m, -limit, limit), low, high))
        dr.eval(trial)
        new_terms = evaluate(trial, softness, noise, fine, hyper)
        better = new_terms[0] < terms[0]
        theta = [dr.select(better, new, old) for new, old in zip(trial, theta)]
        terms = [dr.select(better, new, old) for new, old in zip(new_terms, terms)]
        damping = dr.clip(damping * dr.select(better, 0.25, 6.0), 1e-6, 1e6)
        return theta, terms, damping

    @freeze
    def residuals(theta, softness):
        """|u| of a few pairs of each pixel."""
        pixel = dr.arange(UInt32, dr.width(theta[0]))
        signal, *_ = model(theta[0], theta[1], [dr.exp(t) for t in theta[2 : 2 + n_band]], softness)
        table = signal_table(signal, dr.width(theta[0]))
        out, told = dr.zeros(Float, dr.width(few.phases) // 2), at_thresholds(few, theta)
        dr.eval(told.threshold_on, told.threshold_off)

        def body(k, out):
            u, _ = relative_residual(table, told, constant_light, k, pixel, n_pixel, k < last)
            dr.scatter(out, dr.abs(u), k, k < last, mode=dr.ReduceMode.NoConflicts)
            return k + 1, out

        first = dr.gather(UInt32, few.offset, pixel)
        last = dr.gather(UInt32, few.offset, pixel + 1)
        return dr.while_loop((first, out), lambda k, _: k < last, body, label="residuals")[1]

    first, counts = (few.offset.numpy().astype(np.int64)[:-1], np.diff(pairs.offset.numpy().astype(np.int64)))
    paired, n_shown = np.flatnonzero(counts), np.diff(few.offset.numpy().astype(np.int64))
    shown = first[paired, None] + n_shown[paired, None] * np.arange(N_SHOWN) // N_SHOWN

    def freedom():
        count = counts if heard is pairs else n_shown
        return np.minimum(np.sqrt(count / np.maximum(count - n_unknown, 1)), 2.0)[paired]

    def scatter_of_pixels(theta, softness) -> np.ndarray:
        """Standard deviation of u in each pixel that has pairs, by the median of some |u|."""
        softness = softness if isinstance(softness, Float) else dr.opaque(Float, softness)
        u = residuals(theta, softness).numpy()[shown]
        return 1.4826 * np.median(u, axis=1) * freedom()

    def measure_noise(theta, softness) -> float:
        """Standard deviation of u in most pixels: hot ones fire most events."""
        return float(np.clip(np.median(scatter_of_pixels(theta, softness)), *NOISE_RANGE))

    def noise_factors(theta, softness, noise) -> np.ndarray:
        """Say how much noisier a pixel is than most, at least 1; what its own few pairs say is shrunk toward 1."""
        own = np.minimum(scatter_of_pixels(theta, softness) / noise, 10)
        factor = np.ones(len(counts), np.float32)
        weight = np.minimum(counts[paired], N_SHOWN)
        factor[paired] = np.maximum((N_SHOWN + weight * own) / (N_SHOWN + weight), 1)
        factor[paired[(own > MISFIT) & (counts[paired] > n_unknown)]] = IGNORED
        return factor

    def horizon(theta):
        """Give each pixel's softness: as its surface is curved within it."""
        out = dr.sqrt(dr.square(pixel_horizon(theta[0], theta[1], grid)) + hard * hard)
        dr.make_opaque(out)
        return out

    n_step = 0

    def descend(theta, softness, noise, count, stage=None, fine=False):
        nonlocal n_step
        noise = dr.opaque(Float, noise)
        softness = softness if isinstance(softness, Float) else dr.opaque(Float, softness)
        terms = begin(theta, softness, noise, fine, hyper)
        damping = dr.full(Float, 1e-2, dr.width(theta[0]))
        dr.make_opaque(damping)
        for i in range(count):
            theta, terms, damping = step(theta, terms, damping, softness, noise, fine, hyper)
            dr.eval(theta, terms, damping)
            dr.sync_thread()  # so that Ctrl-C is heard and progress is true
            n_step += 1
            if stage:
                progress(stage, (i + 1) / count)
        return theta, terms

    def offer(theta, terms, candidate, softness, noise):
        """Let a start prove itself; each pixel keeps it where it ends lower."""
        dr.eval(candidate)
        candidate, candidate_terms = descend(candidate, softness, noise, effort.n_try)
        better = candidate_terms[0] < terms[0]
        theta = [dr.select(better, new, old) for new, old in zip(candidate, theta)]
        terms = [dr.select(better, new, old) for new, old in zip(candidate_terms, terms)]
        dr.eval(theta, terms)
        return theta, terms

    def distribution(theta, terms, least=SMALLEST_SPREAD):
        """Mean and spread of the log thresholds over the pixels, from what the data alone say of each."""
        some = slice(None, None, max(1, dr.width(theta[0]) // SAMPLE))
        centre, spread = np.array([float(value[0]) for value in hyper]).reshape(2, 2, 1)
        gains = np.stack([t.numpy()[some] for t in theta[-2:]]).astype(float)
        matrix = np.stack([t.numpy()[some] for t in terms[1 + n_unknown :]], axis=-1).astype(float)
        posterior = np.diagonal(_invert(matrix, n_unknown), axis1=1, axis2=2)[:, -2:].T
        alone = 1 / np.maximum(
            1 / posterior - 1 / spread**2, 1e-2
        )  # variance without the distribution's pull
        gains = centre + (gains - centre) * alone / posterior
        weight = 1 / (alone + spread**2)
        weight *= np.abs(gains - np.median(gains, axis=1, keepdims=True)) < 3 / np.sqrt(weight)
        total = np.sum(weight, axis=1) + 1 / np.square(FIRST_THRESHOLD_SIGMA)  # a few pixels tell little
        centre = np.sum(weight * gains, axis=1) / total
        scatter = np.median((gains - centre[:, None]) ** 2, axis=1) / 0.455 - np.median(alone, axis=1)
        spread = np.sqrt(np.clip(scatter, least**2, 0.25) + 1 / total)
        return [dr.opaque(Float, float(v)) for v in (*centre, *spread)]

    theta = [dr.opaque(Float, 0.0, dr.width(t)) + t for t in start]
    dr.eval(theta)
    for softness, noise, count in effort.stages:
        noise = measure_noise(theta, softness) if noise is None else noise
        theta, _ = descend(theta, softness, noise, count, "descent")
    noise = measure_noise(theta, hard)
    theta, terms = descend(theta, hard, noise, effort.n_final)
    for sweep in range(effort.n_sweep):
        for i, place in enumerate(NEXT):
            candidate = [dr.gather(Float, t, grid.index[place]) for t in theta]
            theta, terms = offer(theta, terms, candidate, hard, noise)
            progress("starts", (sweep * len(NEXT) + i + 1) / (effort.n_sweep * len(NEXT)))
    for round_ in range(effort.n_expectation if thresholds else 0):
        noise = measure_noise(theta, hard)
        theta, terms = descend(theta, hard, noise, effort.n_try, None, effort.fine)
        hyper = distribution(theta, terms, MOVING_SPREAD)
        progress("thresholds", (round_ + 1) / effort.n_expectation)
    heard = pairs
    noise = measure_noise(theta, hard)
    theta, terms = descend(theta, hard, noise, effort.n_final, "refinement", effort.fine)
    if thresholds and (effort.n_expectation or threshold_prior is None):
        hyper = distribution(theta, terms)
        for value in hyper[:2]:
            value += FIRED_LOWER * noise**2
        dr.make_opaque(hyper)
        theta, terms = descend(theta, hard, noise, effort.n_final, None, effort.fine)
    curved = False
    if effort.fine:
        curved_theta, curved_terms = descend(theta, horizon(theta), noise, effort.n_try, None, True)
        curved = float(dr.sum(curved_terms[0] - terms[0])[0]) < 0
        theta = curved_theta if curved else theta

    def softness_at(theta):
        return horizon(theta) if curved else dr.opaque(Float, hard)

    noise = measure_noise(theta, softness_at(theta))
    factor = (
        noise_factors(theta, softness_at(theta), noise) if effort.fine else np.ones(len(counts), np.float32)
    )
    noise_of_pixel = Float(noise * factor)
    cost = begin(theta, softness_at(theta), dr.opaque(Float, noise), effort.fine, hyper)[0]
    if (factor == IGNORED).any():
        heard = without(pairs, factor == IGNORED)

    def terms_at(theta):
        softness = softness_at(theta)
        terms = begin(list(theta), softness, noise_of_pixel, effort.fine, hyper)
        return terms[0], terms[1 : 1 + n_unknown], terms[1 + n_unknown :]

    scale = {}
    if effort.priors:
        theta = _fill(theta, (factor < IGNORED) & (counts > 0), grid.mask)
        posterior = find_posterior(theta, terms_at, grid, n_band, effort.priors, progress)
        theta, covariance, scale = posterior.theta, posterior.covariance, posterior.scale
    else:
        matrix = [m.numpy() for m in terms_at(theta)[2]]
        covariance = _invert(np.stack(matrix, axis=-1).astype(float), n_unknown)
    theta = np.stack([t.numpy() for t in theta], axis=-1)
    gain, gain_sigma = None, None
    if thresholds:
        gain = np.exp(theta[:, -2:])
        gain_sigma = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2)[:, -2:], 0))
    n_map = 2 + n_band
    return Solution(
        theta[:, :n_map],
        covariance[:, :n_map, :n_map],
        cost.numpy(),
        noise,
        factor,
        n_step,
        gain,
        gain_sigma,
        tuple(float(value[0]) for value in hyper) if thresholds else None,
        scale,
    )


def _fill(theta: list, good: np.ndarray, mask: np.ndarray) -> list:
    """Give each pixel that is not good the unknowns of the nearest one that is."""
    if good.all() or not good.any():
        return theta
    number, image = np.zeros(mask.shape, np.uint32), np.zeros(mask.shape, bool)
    number[mask], image[mask] = np.arange(len(good)), good
    nearest = ndimage.distance_transform_edt(~image, return_distances=False, return_indices=True)
    index = dr.uint32_array_t(type(theta[0]))(number[tuple(nearest)][mask])
    return [dr.gather(type(t), t, index) for t in theta]


def _invert(triangle: np.ndarray, n: int) -> np.ndarray:
    """Invert symmetric matrices (n_pixel, n, n) given by their lower triangles."""
    rows, columns = np.tril_indices(n)
    matrix = np.zeros((len(triangle), n, n))
    matrix[:, rows, columns] = triangle
    matrix[:, columns, rows] = triangle
    return np.linalg.inv(matrix)
