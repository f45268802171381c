"""What the events of watched pixels say of a rig: the unknowns of a model, with those of the sensor that all pixels share.

Lag, noise, a shift of all times, the refractory period, a leak, mean thresholds, and each pixel's own thresholds where
one value is told for all, are unknown as in a fit.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from evsdr.calibration.likelihood import SENSOR, Belief, Model, Sums, first_belief, learnt, moved, sum_parts
from evsdr.calibration.watched import Watched
from evsdr.progress import Progress, silent
from evsdr.solve.shared.pixels import STEPS
from evsdr.solve.shared.rig import CONSIDERED, NOT_NEGATIVE, Told

LAG = "tau", "noise"
TIMES = "shift", "refractory"  # light without a lag has kinks: its likelihood is not smooth in a shift
DARK = 1.0  # tolerance of the dark current, over the constant light; guessed
LAG_US = 1e5  # that of the time constant where the light is as bright as that; guessed
START = {"tau": 400.0, "noise": 0.005}  # of a lag [us], and noise
SCATTER, SPREAD = 0.2, 0.1  # of thresholds, relative, before they are known
CLEAR = 4.0  # standard deviations from which there is a lag, and a dark current
N_ROUND, N_STEP = 12, 6  # of steps with one scatter
MOST_SETTLED = 5  # times that steps are made in `fit_events`
SMALL_STEP = 0.1  # of all standard deviations, at which they end
SETTLED = 0.01  # of the scatter
MODEL_NOISE = 0.05  # by which the noise is found too small, relative; measured on patches under an EVK4
MODEL_US = (
    10.0  # how far shift and refractory period are off beside their sigma: as of a fit, see `effects.shared`
)
DAMPING = 1e-3, 1e-9, 1e6  # the first, the least, the most


@dataclass(frozen=True)
class Estimate:
    """What the events say.

    Attributes
    ----------
    x : (n_unknown,) float
    covariance : (n_unknown, n_unknown) float
        From the scatter between pixels, so that errors which a pixel's events share count once; and from what the
        model of the lag and its noise leaves out.
    sensor, sensor_sigma : dict of str to float
        Of `SENSOR`: tau [us] where the light is as bright as the constant light, in which unit dark is, too; noise of
        log I; shift, and refractory period over what is told [us]; leak [log I per us]; log C_on and C_off over what
        is told. A sigma of 0: not there.
    residual : (n_event,) float
        Relative to the threshold, of the events that tell something.
    part, pixel : (n_event,) int
        Whose events these are: which part, and which of its pixels, y * width + x.
    noise : float
        Their standard deviation, without that of photoreceptors.
    converged : bool
    condition : float
        Of the normal equations, after scaling: large where something can't be told.
    """

    x: np.ndarray
    covariance: np.ndarray
    sensor: dict
    sensor_sigma: dict
    residual: np.ndarray
    part: np.ndarray
    pixel: np.ndarray
    noise: float
    converged: bool
    condition: float


@dataclass(frozen=True)
class Settled:
    """The end of some steps."""

    belief: Belief
    sums: Sums
    still: tuple[str, ...]
    pull: np.ndarray
    covariance: np.ndarray
    condition: float
    converged: bool

    def shows(self, name: str, without: "Settled") -> bool:
        """Tell whether an unknown of the sensor is more than noise, and explains the events better than the end without."""
        k = SENSOR.index(name) - len(SENSOR)
        clear = abs(self.belief.x[k]) > CLEAR * np.sqrt(self.covariance[k, k])
        heard = self.sums.heard & without.sums.heard
        return clear and self.cost(heard) < without.cost(heard) - 0.5 * CLEAR**2

    def cost(self, heard: np.ndarray) -> float:
        """Give -log of the posterior of some pixels."""
        return float(self.sums.cost[heard].sum() + 0.5 * self.pull @ self.belief.x**2)


def fit_events(
    parts: Sequence[Watched],
    model: Model,
    start: np.ndarray,
    prior_sigma: np.ndarray,
    told: Told = Told(),
    progress: Progress = silent,
) -> Estimate:
    """Find the unknowns that explain the events best.

    Unknowns with a finite `prior_sigma` are known to lie about 0. The unit of all signals is the constant light C_w.

    Parameters
    ----------
    parts : sequence of Watched
        Of one sensor.
    model : Model
        Signals of the LEDs and their derivatives.
    start : (n_unknown,) float
    prior_sigma : (n_unknown,) float
        Standard deviation about 0; infinite for what is not known before.
    told : Told
        How well the sensor is known.
    progress : callable (detail, share), optional
        Told how far it is.
    """
    n, settle = len(start), _told_of(progress)
    sensor = [LAG_US, DARK, told.noise, told.shift_us, told.refractory_us, told.leak * 1e-6, told.pole]
    prior = np.concatenate([prior_sigma, sensor, [told.thresholds] * 2])
    belief = first_belief(parts, np.append(start, np.zeros(len(SENSOR))), SCATTER, SPREAD)
    found = settle(parts, model, belief, prior, (*LAG, "shift", "dark"))
    x = found.belief.x.copy()
    for name, value in START.items():
        x[n + SENSOR.index(name)] = value
    x[n + SENSOR.index("refractory")] = 0.0
    late = settle(parts, model, replace(found.belief, x=x), prior, (*TIMES, "dark"))
    if late.shows("tau", found):
        found = _with_times(parts, model, late, prior, settle)
        dark = settle(parts, model, found.belief, prior, tuple(set(found.still) - {"dark"}))
        found = dark if dark.shows("dark", found) else found
    sigma = np.sqrt(np.maximum(np.diagonal(found.covariance), 0))
    residual = np.concatenate(found.sums.residual)
    tells, n_event = np.isfinite(residual), [len(part.pixel_of_event) for part in parts]
    return Estimate(
        x=found.belief.x[:n],
        covariance=found.covariance[:n, :n],
        sensor=dict(zip(SENSOR, found.belief.x[n:].tolist())),
        sensor_sigma=dict(zip(SENSOR, sigma[n:].tolist())),
        residual=residual[tells],
        part=np.repeat(np.arange(len(parts)), n_event)[tells],
        pixel=np.concatenate([part.pixel_of_event for part in parts])[tells],
        noise=found.belief.scatter,
        converged=found.converged,
        condition=found.condition,
    )


def _told_of(progress: Progress) -> Callable[..., Settled]:
    """Give `_settle` that tells how far it is, of the five times that it is called at most."""
    calls = itertools.count()

    def settle(*asked) -> Settled:
        k = next(calls)
        return _settle(*asked, lambda share: progress("fit events", (k + share) / MOST_SETTLED))

    return settle


def _with_times(
    parts: Sequence[Watched], model: Model, late: Settled, prior: np.ndarray, settle: Callable[..., Settled]
) -> Settled:
    """Free those times that are not as told, beyond what the model of a lag and its noise tells wrong."""
    free = settle(parts, model, late.belief, prior, ("dark",))
    near = tuple(name for name in TIMES if not free.shows(name, late))
    if not near:
        return free
    return late if near == TIMES else settle(parts, model, late.belief, prior, (*near, "dark"))


def _settle(
    parts: Sequence[Watched],
    model: Model,
    belief: Belief,
    prior: np.ndarray,
    still: tuple[str, ...],
    tell: Callable[[float], object],
) -> Settled:
    """Make damped steps (Marquardt 1963) of all but some unknowns of the sensor."""
    n, still = len(prior) - len(SENSOR), (*still, CONSIDERED)
    free = np.setdiff1d(np.arange(len(prior)), [n + SENSOR.index(name) for name in still])
    stirred = tuple(name for name in STEPS if name not in still)
    least = np.append(np.full(n, -np.inf), [0.0 if name in NOT_NEGATIVE else -np.inf for name in SENSOR])
    least[n + SENSOR.index("refractory")] = -min(part.refractory_us for part in parts)
    pull, damping, converged = prior**-2.0, DAMPING[0], False
    for round_ in range(N_ROUND):
        tell(round_ / N_ROUND)
        sums, longest = sum_parts(parts, model, belief, stirred), 0.0
        for _ in range(N_STEP):
            matrix, slope = sums.matrix + np.diag(pull), sums.gradient + pull * belief.x
            scale = _scale(matrix)[free]
            scaled = matrix[np.ix_(free, free)] / np.outer(scale, scale)
            step = np.zeros(len(prior))
            step[free] = np.linalg.solve(scaled + damping * np.eye(len(free)), -slope[free] / scale) / scale
            new = moved(belief, step, sums, least)
            after = sum_parts(parts, model, new, stirred)
            change = (after.cost - sums.cost)[sums.heard].sum() + 0.5 * pull @ (new.x**2 - belief.x**2)
            if not change <= 0:
                damping = min(damping * 10, DAMPING[2])
                continue
            damping = max(damping / 10, DAMPING[1])
            length = float(np.abs((new.x - belief.x)[free] * scale).max())
            belief, sums, longest = new, after, max(longest, length)
            if length < SMALL_STEP:
                break
        told, belief = belief.scatter, learnt(parts, belief, sums)
        if converged := longest < SMALL_STEP and abs(told / belief.scatter - 1) < SETTLED:
            break
    matrix = sums.matrix + np.diag(pull)
    covariance, condition = _covariance(sums, matrix[np.ix_(free, free)], pull, free)
    if "tau" not in still:
        covariance += _left_out(matrix, free, belief.x)
    return Settled(belief, sums, still, pull, covariance, condition, converged)


def _scale(matrix: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Invert a symmetric matrix that may be singular."""
    scale = np.outer(_scale(matrix), _scale(matrix))
    return np.linalg.pinv(matrix / scale, rcond=1e-12) / scale


def _covariance(
    sums: Sums, matrix: np.ndarray, pull: np.ndarray, free: np.ndarray
) -> tuple[np.ndarray, float]:
    """Give the sandwich of Liang and Zeger 1986, Biometrika 73(1), eq. 7, with pixels as clusters, and the condition.

    Unknowns bend the scores of few clusters toward 0: the factor is that of MacKinnon and White 1985, J. Econometrics
    29(3), eq. 5.
    """
    scale, inverse = _scale(matrix), _inverse(matrix)
    score = sums.score[:, free]
    few = len(score) / max(len(score) - len(free), 1)
    covariance = np.zeros((len(pull), len(pull)))
    covariance[np.ix_(free, free)] = inverse @ (few * score.T @ score + np.diag(pull[free])) @ inverse
    return covariance, float(np.linalg.cond(matrix / np.outer(scale, scale)))


def _left_out(matrix: np.ndarray, free: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Give the covariance of what follows from times and noise that the model of a lag tells wrong."""
    first = len(x) - len(SENSOR)
    wrong = {first + SENSOR.index(name): MODEL_US for name in TIMES}
    noise = first + SENSOR.index("noise")
    wrong[noise] = MODEL_NOISE * x[noise]
    about, others = list(wrong), np.setdiff1d(free, list(wrong))
    response = np.zeros((len(x), len(about)))
    response[about] = np.eye(len(about))
    response[others] = -_inverse(matrix[np.ix_(others, others)]) @ matrix[np.ix_(others, about)]
    response *= list(wrong.values())
    return response @ response.T
