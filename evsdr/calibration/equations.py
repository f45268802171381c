"""Event pairs as equations for what is unknown of a rig, and their robust solution.

The photoreceptor lags behind the light, more so in the dark: d log V / dt = (log I - log V) I / kappa. To
first order it shows log V = log I - kappa I' / I^2, with one unknown kappa for all pixels.

Plain least squares is biased: the time of an event depends on the noise of its own threshold (10 % of noise
make C_w 2 % too large). So the equations are weighted with the derivatives at the times that are expected
without noise, as instrumental variables (Reiersol 1945, "Confluence analysis by means of instrumental sets of
variables").
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_array

from evsdr.errors import InputError
from evsdr.events.pairs import pair_events
from evsdr.records import Recording

MOST_PAIRS = 40_000  # that are fitted; more change nothing
LEAST_CROSSFADE = 0.05  # of a slot: after a hard switch an event tells no exact change
WIDE = 3.0  # scale of the Cauchy loss in standard deviations
START_NOISE = 0.2  # relative to the thresholds, before it is known
LEAST_NOISE = 1e-3
LAG_SIGMA = 100.0  # what is known of kappa before [ms]
MOST_STEPS = 20  # with instruments
SMALL_STEP = 0.1  # of all standard deviations, at which they end
N_PASS = 3  # fits, each with the noise that the one before found


@dataclass(frozen=True)
class PairTerms:
    """Event pairs: log V_end - log V_start = change, where I = (1 - fade) A[led] + fade A[next] + C_w.

    Attributes
    ----------
    point : (n_pair,) int
        Which surface point is seen.
    led : (n_pair, 4) int
        LEDs at the end (now, next) and at the start (now, next); -1 is dark.
    share : (n_pair, 4) float
        Their weights, 1 - fade and fade, at end and start.
    rate : (n_pair, 4) float
        Change of the weights over time [1/ms].
    change : (n_pair,) float
        p C.
    cluster : (n_pair,) int
        Pixel: what its pairs have in common is one error, not many.
    """

    point: np.ndarray
    led: np.ndarray
    share: np.ndarray
    rate: np.ndarray
    change: np.ndarray
    cluster: np.ndarray


@dataclass(frozen=True)
class Estimate:
    """What the pairs say.

    Attributes
    ----------
    x : (n_unknown,) float
    lag_ms, lag_ms_sigma : float
        kappa: the photoreceptor's time constant where the light is as bright as the constant light [ms].
    covariance : (n_unknown, n_unknown) float
        From the scatter between pixels, so that errors which a pixel's pairs share count once.
    residual : (n_pair,) float
        Relative to the threshold: (change told - change seen) / C.
    noise : float
        Robust standard deviation of the residual.
    converged : bool
    condition : float
        Of the normal equations, after scaling: large where something can't be told.
    """

    x: np.ndarray
    lag_ms: float
    lag_ms_sigma: float
    covariance: np.ndarray
    residual: np.ndarray
    noise: float
    converged: bool
    condition: float


# x -> A (n_led, n_point), dA by each LED's own unknowns (n_led, n_point, n_own), dA by shared unknowns
# (n_led, n_point, n_shared). Unknowns: those of LED 0, of LED 1, ..., then the shared ones.
Model = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


def collect_pairs(recording: Recording, mask: np.ndarray, point: np.ndarray) -> PairTerms:
    """List the event pairs of some pixels.

    Parameters
    ----------
    recording : Recording
        Under the ring.
    mask : (height, width) bool
        Pixels that count.
    point : (height, width) int
        Surface point of each pixel.

    Raises
    ------
    InputError
        The LEDs switch hard, or no pair remains.
    """
    schedule, sensor = recording.schedule, recording.sensor
    if schedule.crossfade < LEAST_CROSSFADE:
        raise InputError(
            f"schedule/crossfade is {schedule.crossfade:g}, and after a hard switch events tell no exact "
            f"change of light; record the calibration with a crossfade of {LEAST_CROSSFADE:g} or more, "
            "best 1."
        )
    pairs = pair_events(recording, mask)
    pixel = np.repeat(np.arange(mask.size), np.diff(pairs.offset.astype(np.int64)))
    lit = np.append(schedule.order, schedule.order[0])
    led, share, rate = [], [], []
    fade_rate = 1e3 / (schedule.crossfade * schedule.slot_us)
    for phase in (pairs.phase_end, pairs.phase_start):
        slot = phase.astype(np.int64)
        fade = phase.astype(np.float64) - slot
        led += [lit[slot], lit[slot + 1]]
        share += [1 - fade, fade]
        fading = np.where(fade > 0, fade_rate, 0.0)
        rate += [-fading, fading]
    on, off = (
        np.broadcast_to(np.asarray(c, float), mask.shape).ravel()[pixel]
        for c in (sensor.contrast_threshold_on, sensor.contrast_threshold_off)
    )
    change = np.where(pairs.polarity > 0, on, -off)
    led, share, rate = (np.stack(columns, axis=1) for columns in (led, share, rate))
    return PairTerms(point.ravel()[pixel], led, share, rate, change, pixel)


def join_pairs(parts: list[PairTerms]) -> PairTerms:
    """Put the pairs of several recordings together; their pixels stay apart."""
    start = np.cumsum([0, *(part.cluster.max() + 1 for part in parts)])
    names = ("point", "led", "share", "rate", "change")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return PairTerms(**joined, cluster=np.concatenate([p.cluster + s for p, s in zip(parts, start)]))


def sample_pairs(pairs: PairTerms, seed: int) -> PairTerms:
    """Keep at most `MOST_PAIRS`, drawn evenly."""
    n_pair = len(pairs.change)
    if n_pair <= MOST_PAIRS:
        return pairs
    kept = np.sort(np.random.default_rng(seed).choice(n_pair, MOST_PAIRS, replace=False))
    return PairTerms(*(getattr(pairs, field.name)[kept] for field in fields(pairs)))


def fit_pairs(pairs: PairTerms, model: Model, start: np.ndarray, prior_sigma: np.ndarray) -> Estimate:
    """Find the unknowns that explain the pairs best.

    Residuals are relative to the threshold, under Cauchy's loss. Unknowns with a finite `prior_sigma` are
    known to lie about 0. The unit of all signals is the constant light C_w.

    Parameters
    ----------
    pairs : PairTerms
    model : Model
        Signals of the LEDs and their derivatives.
    start : (n_unknown,) float
    prior_sigma : (n_unknown,) float
        Standard deviation about 0; infinite for what is not known before.
    """
    x, prior = np.append(start, 0.0), np.append(prior_sigma, LAG_SIGMA)
    known, noise = np.flatnonzero(np.isfinite(prior)), START_NOISE
    for _ in range(N_PASS):
        result = least_squares(
            lambda v: np.append(_residuals(pairs, model(v[:-1])[0], v[-1]), noise * v[known] / prior[known]),
            x,
            jac=lambda v: np.vstack(
                [_jacobian(pairs, model(v[:-1]), v[-1]), noise * np.diag(1 / prior)[known]]
            ),
            loss="cauchy",
            f_scale=WIDE * noise,
            x_scale="jac",
            ftol=1e-7,
            max_nfev=60,
        )
        x = result.x
        residual = _residuals(pairs, model(x[:-1])[0], x[-1])
        noise = max(1.4826 * float(np.median(np.abs(residual))), LEAST_NOISE)
    for _ in range(MOST_STEPS):
        step, covariance, condition, residual = _instrument_step(pairs, model, x, prior, noise)
        x = x - step
        sigma = np.sqrt(np.diagonal(covariance))
        if small := bool((np.abs(step) < SMALL_STEP * sigma).all()):
            break
    return Estimate(
        x=x[:-1],
        lag_ms=float(x[-1]),
        lag_ms_sigma=float(sigma[-1]),
        covariance=covariance[:-1, :-1],
        residual=residual,
        noise=noise,
        converged=small,
        condition=condition,
    )


def _instrument_step(pairs, model, x, prior, noise):
    """Give a Gauss-Newton step of the weighted equations, covariance, condition, and residuals.

    The covariance is the sandwich of Liang and Zeger 1986, Biometrika 73(1), eq. 7, with pixels as clusters.
    """
    modelled = model(x[:-1])
    residual = _residuals(pairs, modelled[0], x[-1])
    weight = 1 / (1 + (residual / (WIDE * noise)) ** 2)
    instrument = weight[:, None] * _jacobian(_expected(pairs, modelled[0]), modelled, x[-1])
    pull = (noise / prior) ** 2
    normal = instrument.T @ _jacobian(pairs, modelled, x[-1]) + np.diag(pull)
    length = np.sqrt(np.maximum(np.abs(np.diagonal(normal)), 1e-300))
    scaled = normal / np.outer(length, length)
    inverse = np.linalg.pinv(scaled, rcond=1e-12) / np.outer(length, length)
    _, cluster = np.unique(pairs.cluster, return_inverse=True)
    gather = csr_array((residual, (cluster, np.arange(len(cluster)))))
    score = gather @ instrument
    covariance = inverse @ (score.T @ score + np.diag(noise**2 * pull)) @ inverse.T
    step = inverse @ (instrument.T @ residual + pull * x)
    return step, covariance, float(np.linalg.cond(scaled)), residual


def _light(pairs: PairTerms, signal: np.ndarray) -> tuple[np.ndarray, ...]:
    """Give I and dI/dt [1/ms] at end and start of each pair (2, n_pair); the unit is C_w."""
    dark = np.vstack([signal, np.zeros_like(signal[:1])])  # LED -1
    seen = dark[pairs.led, pairs.point[:, None]]
    light, slope = (
        np.stack([part[:, :2].sum(axis=1), part[:, 2:].sum(axis=1)])
        for part in (pairs.share * seen, pairs.rate * seen)
    )
    return 1 + light, slope


def _expected(pairs: PairTerms, signal: np.ndarray) -> PairTerms:
    """Move the ends of the pairs to where they would be without noise."""
    light, _ = _light(pairs, signal)
    dark = np.vstack([signal, np.zeros_like(signal[:1])])
    now, after = dark[pairs.led[:, 0], pairs.point], dark[pairs.led[:, 1], pairs.point]
    rise = np.where(np.abs(after - now) > 1e-9, after - now, 1e-9)
    fade = np.clip((light[1] * np.exp(pairs.change) - 1 - now) / rise, 0, 1)
    fading = pairs.rate[:, 1] > 0
    share = pairs.share.copy()
    share[:, 0], share[:, 1] = np.where(fading, 1 - fade, share[:, 0]), np.where(fading, fade, share[:, 1])
    return replace(pairs, share=share)


def _residuals(pairs: PairTerms, signal: np.ndarray, lag: float) -> np.ndarray:
    light, slope = _light(pairs, signal)
    shown = np.log(light) - lag * slope / light**2
    return (shown[0] - shown[1] - pairs.change) / np.abs(pairs.change)


def _jacobian(pairs: PairTerms, modelled: tuple[np.ndarray, ...], lag: float) -> np.ndarray:
    signal, own, shared = modelled
    n_led, n_own, n_shared = len(signal), own.shape[2], shared.shape[2]
    light, slope = _light(pairs, signal)
    by_light, by_slope = 1 / light + 2 * lag * slope / light**3, -lag / light**2
    jacobian = np.zeros((len(pairs.change), n_led * n_own + n_shared + 1))
    row, size = np.arange(len(jacobian)), np.abs(pairs.change)
    for k in range(4):
        when, sign = k // 2, 1 - 2 * (k // 2)
        led = pairs.led[:, k]
        gain = by_light[when] * pairs.share[:, k] + by_slope[when] * pairs.rate[:, k]
        gain *= sign * (led >= 0) / size
        at = np.maximum(led, 0)
        for i in range(n_own):
            jacobian[row, at * n_own + i] += gain * own[at, pairs.point, i]
        jacobian[:, n_led * n_own : -1] += gain[:, None] * shared[at, pairs.point]
    shown = slope / light**2
    jacobian[:, -1] = (shown[1] - shown[0]) / size
    return jacobian
