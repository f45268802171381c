"""Photoreceptors that lag and are noisy: how much, as the events themselves say.

In dim light an event comes late, and noise makes it early; the solver would take both for other light. Two numbers,
the time constant at I = 1 and the noise with which events fire, make the events of a whole sensor agree with the maps.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from evsdr.effects.wiring import signals_of
from evsdr.events.pairs import pair_events
from evsdr.events.photoreceptor import Photoreceptors
from evsdr.model.illumination import Illumination
from evsdr.records import Recording
from evsdr.solve import trial
from evsdr.solve.levenberg import Solution
from evsdr.solve.pair_data import PairData, pack_phases, pack_slots
from evsdr.solve.problem import Problem

N_PIXEL = 500  # pixels that tell it
FEWEST_EVENTS = 20  # of such a pixel
FEWEST_PIXELS = 20
CLEAR = 1.5  # noise of such a pixel, relative to most, at most: in others more than a lag may be wrong
TAU_US = (0.0, 10.0, 15.0, 22.0, 33.0, 50.0, 75.0, 110.0, 160.0, 240.0, 360.0, 540.0)  # that are tried
FINE = np.linspace(-0.6, 0.6, 7)  # around the best, relative to the distance of its neighbours
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
    """

    tau_us: float
    tau_sigma_us: float
    noise: float = 0.0

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
    few = _of_pixels(recording, problem, row)

    def read(lags):
        lagging = [photoreceptors(few, problem, solution, lag, row) for lag in lags]
        cases = [_pairs(few, problem, row, receptors) for receptors in lagging]
        return cases, problem.illumination, row, thresholds

    tau = _smallest(lambda values: trial.costs(*read([Lag(v, 0.0) for v in values])).sum(axis=1), TAU_US)
    if tau is None:
        return None
    given = read([Lag(*tau), Lag(*tau, NOISE)])
    return Lag(*tau, _noise(*given[:3], trial.solve(*given)))


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
    chosen = light.gather(type(cases[0].offset)(row.astype(np.uint32)))
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
    light_of_slot = signals_of(light, theta)[led] + float(light.constant_light[0])

    def log_light(phase):
        slot = np.floor(phase).astype(np.int64) % len(led)  # phases may have been rounded up
        fade, following = phase % 1, (slot + 1) % len(led)
        return np.log((1 - fade) * light_of_slot[slot, pixel] + fade * light_of_slot[following, pixel])

    threshold = np.stack([pairs.threshold_on.numpy(), pairs.threshold_off.numpy()], axis=-1)
    threshold = threshold if gain is None else threshold * gain
    residual = polarity * (log_light(end) - log_light(start)) - threshold[pixel, (polarity < 0).astype(int)]
    follows = np.flatnonzero(np.diff(pixel) == 0) + 1
    return residual[follows], polarity[follows] != polarity[follows - 1]


def _smallest(costs: Callable, candidates: tuple) -> tuple[float, float] | None:
    """Find the number of smallest cost, and one standard deviation; None if it might as well be the first, 0."""
    cost = costs(candidates)
    best = int(np.argmin(cost))
    if cost[0] - cost[best] < DECISIVE:
        return None
    step = candidates[min(best + 1, len(candidates) - 1)] - candidates[best - 1]
    fine = np.clip(candidates[best] + 0.5 * step * FINE, 0, None)
    curve = np.polynomial.Polynomial.fit(fine, costs(fine), 2).convert()
    if curve.coef[2] <= 0:  # few and contrary events: the coarse ones have to do
        first = min(best, len(candidates) - 2) - 1
        around = slice(first, first + 3)
        curve = np.polynomial.Polynomial.fit(candidates[around], cost[around], 2).convert()
    if curve.coef[2] <= 0:
        return None
    value = float(np.clip(-0.5 * curve.coef[1] / curve.coef[2], fine[0], fine[-1]))
    sigma = float((2 * curve.coef[2]) ** -0.5)
    return (value, sigma) if value > SIGNIFICANT * sigma else None


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
    row = np.arange(problem.n_pixel) if row is None else row
    chosen = problem.illumination.gather(type(problem.pairs.offset)(row.astype(np.uint32)))
    signal = signals_of(chosen, solution.theta[row])
    schedule = recording.schedule
    led = np.where(schedule.order < 0, len(signal) - 1, schedule.order)
    light = (signal[led] + float(problem.illumination.constant_light[0])).T
    row_of = np.full(problem.grid.mask.size, -1, np.int32)
    row_of[problem.pixel[row]] = np.arange(len(row))
    tau_slots = lag.tau_us / schedule.slot_us
    return Photoreceptors.under(light, row_of, tau_slots, schedule.crossfade, lag.noise)


def _of_pixels(recording: Recording, problem: Problem, row: np.ndarray) -> Recording:
    """Keep the events of some pixels of a problem."""
    events = recording.events
    chosen = np.zeros(problem.grid.mask.shape, bool)
    chosen.ravel()[problem.pixel[row]] = True
    keep = chosen[events.y, events.x]
    parts = {name: getattr(events, name)[keep] for name in ("x", "y", "p", "t")}
    return replace(recording, events=replace(events, **parts))


def _pairs(
    recording: Recording, problem: Problem, row: np.ndarray, receptors: Photoreceptors | None
) -> PairData:
    """Pair the events of some pixels of a problem."""
    known = problem.pairs
    Float, UInt32 = type(known.phases), type(known.offset)
    pairs = pair_events(recording, None, receptors)
    count = np.diff(pairs.offset.astype(np.int64))[problem.pixel[row]]
    return PairData(
        offset=UInt32(np.append(0, np.cumsum(count)).astype(np.uint32)),
        phases=Float(pack_phases(pairs.phase_start, pairs.phase_end, pairs.polarity)),
        threshold_on=Float(known.threshold_on.numpy()[row]),
        threshold_off=Float(known.threshold_off.numpy()[row]),
        slot_leds=UInt32(pack_slots(recording.schedule.order, problem.illumination.n_led)),
    )


def looks_for_lag(asked: str, solver: str, thorough: bool) -> tuple[bool, str]:
    """Decide whether to ask the events how late they are, and say why not.

    Parameters
    ----------
    asked : str
        `auto` or `off`.
    solver : str
        `lm` or `adam`.
    thorough : bool
        Whether the preset looks for what shows in residuals.
    """
    if asked == "off":
        return False, "not modelled: asked for by --lag off"
    if solver != "lm" or not thorough:
        return False, f"not looked for by the {'preset fast' if solver == 'lm' else 'solver adam'}"
    return True, "not modelled: the events show none"
