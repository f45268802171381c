"""Photoreceptors that lag and are noisy: how much, as the events themselves say.

In dim light an event comes late, and noise makes it early; the solver would take both for other light. Two numbers,
the time constant at I = 1 and the noise with which events fire, make the events of a whole sensor agree with the maps.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.sensitivity import against
from evsdr.events.photoreceptor import Photoreceptors
from evsdr.metrics import angular_error_deg
from evsdr.model.arrays import owned
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing, signals_of
from evsdr.records import Recording
from evsdr.solve import trial
from evsdr.solve.pair_data import PairData
from evsdr.solve.problem import Problem
from evsdr.solve.solution import Solution

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World

N_PIXEL = 500  # pixels that tell it
FEWEST_EVENTS = 20  # of such a pixel
FEWEST_PIXELS = 20
CLEAR = 1.5  # noise of such a pixel, relative to most, at most: in others more than a lag may be wrong
TAU_US = (0.0, 10.0, 15.0, 22.0, 33.0, 50.0, 75.0, 110.0, 160.0, 240.0, 360.0, 540.0)  # that are tried
NOISE, MOST_NOISE = 0.01, 0.04  # of log I, that is tried, and at most
NOISE_SHARE = 2 / 3  # of the noise at which residuals look right: that is too much, on simulated scenes
DECISIVE = 20.0  # gain in log likelihood from which there is a lag
SIGNIFICANT = 4.0  # standard deviations from 0, from which a number counts


@dataclass(frozen=True)
class Lag:
    """What photoreceptors make of log I.

    Attributes
    ----------
    tau_us, tau_sigma_us : float
        Time constant at I = 1, and one standard deviation of the estimate [us].
    noise : float
        See `photoreceptor.Photoreceptors`.
    error_deg : float
        Mean angle that it turns normals by if it is left out [deg].
    """

    tau_us: float
    tau_sigma_us: float
    noise: float = 0.0
    error_deg: float = 0.0

    def __str__(self) -> str:
        late = f"events are {self.tau_us:.3g} +- {self.tau_sigma_us:.2g} us / I late"
        early = f", by noise early by {self.noise:.2g} of log I" if self.noise else ""
        return f"modelled: {late}{early}, as they say themselves"


def find_lag(recording: Recording, problem: Problem, solution: Solution, thresholds: bool) -> Lag | None:
    """Estimate what the photoreceptors do, from events and a first fit.

    Parameters
    ----------
    recording : Recording
    problem : Problem
        What light the pixels get.
    solution : Solution
        The fit: what intensity each event came from.
    thresholds : bool
        Whether contrast thresholds are unknown.

    Returns
    -------
    Lag
        None if no lag is needed to explain the events.
    """
    counts = np.diff(problem.pairs.offset.numpy().astype(np.int64))
    clear = np.flatnonzero((counts >= FEWEST_EVENTS) & (solution.noise_factor < CLEAR))
    if len(clear) < FEWEST_PIXELS:
        return None
    row = np.sort(np.random.default_rng(0).permutation(clear)[:N_PIXEL])
    few = trial.of_recording(recording, problem, row)

    def read(lags):
        lagging = [photoreceptors(few, problem, solution, lag, row) for lag in lags]
        cases = [trial.read(few, problem, row, receptors) for receptors in lagging]
        return cases, problem.illumination, row, thresholds

    def costs(values):
        return trial.costs(*read([Lag(v, 0.0) for v in values])).sum(axis=1)

    found = trial.search_scalar(costs, TAU_US)
    if found.gain < DECISIVE or found.value <= SIGNIFICANT * found.sigma:
        return None
    tau = found.value, found.sigma
    given = read([Lag(*tau), Lag(*tau, NOISE)])
    noise = _noise(*given[:3], trial.solve(*given))
    late, mended = _normals(trial.solve(*read([Lag(0.0, 0.0), Lag(*tau, noise)])).theta).reshape(2, -1, 3)
    return Lag(*tau, noise, float(angular_error_deg(late, mended).mean()))


def _normals(theta: np.ndarray) -> np.ndarray:
    """Give vectors (n_pixel, 3) along the normals of slopes."""
    return np.column_stack([-theta[:, :2], np.ones(len(theta))])


def _noise(cases: list[PairData], light: Illumination, row: np.ndarray, solution: Solution) -> float:
    """Give the noise with which events fire: that with which turns of polarity need no lower thresholds.

    Parameters
    ----------
    cases : list of PairData
        Pairs without noise, and with `NOISE`.
    light : Illumination
    row : (n_pixel,) int
        The pixels of each case, in `light`.
    solution : Solution
        What fits them.
    """
    chosen = light.gather(owned(type(cases[0].offset), row))
    gaps = []
    for k, case in enumerate(cases):
        part = slice(k * len(row), (k + 1) * len(row))
        gain = None if solution.threshold_gain is None else solution.threshold_gain[part]
        residual, turns = _residuals(case, chosen, solution.theta[part], gain)
        if min(np.count_nonzero(turns), np.count_nonzero(~turns)) < FEWEST_EVENTS:
            return 0.0
        gaps.append(np.median(residual[~turns]) - np.median(residual[turns]))
        if k == 0:
            sigma = 1.9 * np.median(np.abs(residual)) / np.sqrt(np.count_nonzero(turns))
    if not gaps[0] > max(gaps[1], SIGNIFICANT * sigma):
        return 0.0
    return float(NOISE_SHARE * min(NOISE * gaps[0] / (gaps[0] - gaps[1]), MOST_NOISE))


def _residuals(
    pairs: PairData, light: Illumination, theta: np.ndarray, gain: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Give p (log I - log I at the start) - C of pairs, and which of them turn the polarity.

    Those that are the first of their pixel are left out.
    """
    count = np.diff(pairs.offset.numpy().astype(np.int64))
    pixel = np.repeat(np.arange(len(count)), count)
    start, coded = pairs.phases.numpy().reshape(-1, 2).astype(np.float64).T
    polarity, end = np.sign(coded), np.abs(coded) - 1
    led = pairs.slot_leds.numpy()[:-1] & 0xFFFF
    light_of_slot = signals_of(LambertianRing(light), theta)[led] + float(light.constant_light[0])

    def log_light(phase):
        slot = np.floor(phase).astype(np.int64) % len(led)  # phases may have been rounded up
        fade, following = phase % 1, (slot + 1) % len(led)
        return np.log((1 - fade) * light_of_slot[slot, pixel] + fade * light_of_slot[following, pixel])

    threshold = np.stack([pairs.threshold_on.numpy(), pairs.threshold_off.numpy()], axis=-1)
    threshold = threshold if gain is None else threshold * gain
    residual = polarity * (log_light(end) - log_light(start)) - threshold[pixel, (polarity < 0).astype(int)]
    follows = np.flatnonzero(np.diff(pixel) == 0) + 1
    return residual[follows], polarity[follows] != polarity[follows - 1]


def photoreceptors(
    recording: Recording, problem: Problem, solution: Solution, lag: Lag, row: np.ndarray | None = None
) -> Photoreceptors | None:
    """Give the photoreceptors of a problem's pixels under the light of a fit; None if they don't lag.

    Parameters
    ----------
    row : (n,) int, optional
        Pixels of the problem; all by default.
    """
    if lag.tau_us == 0:
        return None
    if row is None:
        row, model = np.arange(problem.n_pixel), problem.model
    else:
        model = LambertianRing(problem.illumination.gather(owned(type(problem.pairs.offset), row)))
    signal = signals_of(model, solution.theta[row])
    schedule = recording.schedule
    led = np.where(schedule.order < 0, len(signal) - 1, schedule.order)
    light = (signal[led] + float(problem.illumination.constant_light[0])).T
    row_of = np.full(problem.grid.mask.size, -1, np.int32)
    row_of[problem.pixel[row]] = np.arange(len(row))
    tau_slots = lag.tau_us / schedule.slot_us
    return Photoreceptors.under(light, row_of, tau_slots, schedule.crossfade, lag.noise)


class PhotoreceptorLag:
    """Events that come late in dim light, and early by noise."""

    name, option, when = "photoreceptor lag", "lag", "alone"

    def decide(self, asked: str, world: "World", fitted: "Fitted") -> Decision:
        """Ask the events how late they are."""
        if asked == "off":
            return Decision(self.name, False, "not modelled: asked for by --lag off")
        if not world.terms.thorough:
            who = "preset fast" if world.terms.solver == "lm" else "solver adam"
            return Decision(self.name, False, f"not looked for by the {who}")
        lag = find_lag(world.recording, fitted.problem, fitted.solution, world.thresholds)
        if lag is None:
            return Decision(self.name, False, "not modelled: the events show none")
        error, limit = lag.error_deg, world.terms.limit_deg
        modelled = error > limit
        why = str(lag) if modelled else f"not modelled: lag, {against(error, modelled, limit)}"
        found = {"tau_us": lag.tau_us, "tau_sigma_us": lag.tau_sigma_us, "noise": lag.noise}
        return Decision(self.name, modelled, why, error, found, lag)

    def model(self, world: "World", decision: Decision) -> "World":
        """Pair events as such photoreceptors show them."""
        return replace(world, lag=decision.answer)
