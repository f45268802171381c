"""The photoreceptor's lag: in dim light an event comes late, and the solver would take that for other light.

A photoreceptor follows log I with a time constant that falls with the light, tau / I. What an event tells of the light
at t is therefore true of t - tau / I(t). One number tau makes events of a whole sensor agree with the maps.
"""

from dataclasses import replace

import numpy as np

from evsdr import trial
from evsdr.event_terms import PairData, pack_phases, pack_slots
from evsdr.faults import signals_of
from evsdr.lm import Solution
from evsdr.pairs import CHUNK, pair_events
from evsdr.problem import Problem
from evsdr.records import Recording
from evsdr.ring_light import phase

N_PIXEL = 300  # pixels that tell it
FEWEST_EVENTS = 20  # of such a pixel
FEWEST_PIXELS = 20
CLEAR = 1.5  # noise of such a pixel, relative to most, at most: in others more than a lag may be wrong
CANDIDATES_US = (0.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0)  # at the light of a white patch
FINE = np.linspace(-0.6, 0.6, 7)  # around the best, relative to the distance of its neighbours
DECISIVE = 20.0  # gain in log likelihood, and standard deviations from 0, from which there is a lag
SIGNIFICANT = 4.0
LONGEST_SLOTS = 0.5  # no event comes later than that


def find_lag(
    recording: Recording, problem: Problem, solution: Solution, thresholds: bool
) -> tuple[float, float] | None:
    """Estimate tau, the time constant at I = 1, from events and a first fit.

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
    tau_us, sigma_us : float
        Estimate and one standard deviation [us]; None if no lag is needed to explain the events.
    """
    counts = np.diff(problem.pairs.offset.numpy().astype(np.int64))
    clear = np.flatnonzero((counts >= FEWEST_EVENTS) & (solution.noise_factor < CLEAR))
    if len(clear) < FEWEST_PIXELS:
        return None
    row = np.sort(np.random.default_rng(0).permutation(clear)[:N_PIXEL])
    few = _of_pixels(recording, problem, row)

    def costs(candidates):
        cases = [_pairs(without_lag(few, problem, solution, tau), problem, row) for tau in candidates]
        return trial.costs(cases, problem.illumination, row, thresholds).sum(axis=1)

    cost = costs(CANDIDATES_US)
    best = int(np.argmin(cost))
    if cost[0] - cost[best] < DECISIVE:
        return None
    step = CANDIDATES_US[min(best + 1, len(CANDIDATES_US) - 1)] - CANDIDATES_US[best - 1]
    fine = np.clip(CANDIDATES_US[best] + 0.5 * step * FINE, 0, None)
    curve = np.polynomial.Polynomial.fit(fine, costs(fine), 2).convert()
    if curve.coef[2] <= 0:  # few and contrary events: the coarse ones have to do
        around = slice(best - 1, best + 2)
        curve = np.polynomial.Polynomial.fit(CANDIDATES_US[around], cost[around], 2).convert()
    if curve.coef[2] <= 0:
        return None
    tau = float(np.clip(-0.5 * curve.coef[1] / curve.coef[2], fine[0], fine[-1]))
    sigma = float((2 * curve.coef[2]) ** -0.5)
    return (tau, sigma) if tau > SIGNIFICANT * sigma else None


def without_lag(recording: Recording, problem: Problem, solution: Solution, tau_us: float) -> Recording:
    """Give each event the time at which the light was what it tells of.

    Parameters
    ----------
    recording : Recording
    problem : Problem
        What light its pixels get; events of other pixels keep their times.
    solution : Solution
        Says with the light what intensity each event came from.
    tau_us : float
        Time constant at I = 1 [us].

    Returns
    -------
    Recording
        Events that are out of order by as much as they were late.
    """
    if tau_us == 0:
        return recording
    events, schedule = recording.events, recording.schedule
    signal = signals_of(problem.illumination, solution.theta).astype(np.float32)
    veil = float(problem.illumination.constant_light[0])
    row_of = np.full(problem.grid.mask.size, -1, np.int32)
    row_of[problem.pixel] = np.arange(problem.n_pixel)
    led = np.where(schedule.order < 0, len(signal) - 1, schedule.order)
    following = np.roll(led, -1)
    longest = LONGEST_SLOTS * schedule.slot_us
    t = events.t.copy()
    for k in range(0, len(t), CHUNK):
        part = slice(k, k + CHUNK)
        row = row_of[events.y[part].astype(np.int64) * recording.sensor.width + events.x[part]]
        at, inside = phase(t[part], schedule, recording.round_start_us)
        slot = at.astype(np.int64)
        fade = at - slot
        light = (1 - fade) * signal[led[slot], row] + fade * signal[following[slot], row] + veil
        late = np.minimum(tau_us / light, longest)
        t[part] -= np.where(inside & (row >= 0), np.rint(late), 0).astype(np.int64)
    return replace(recording, events=replace(events, t=t))


def _of_pixels(recording: Recording, problem: Problem, row: np.ndarray) -> Recording:
    """Keep the events of some pixels of a problem."""
    events = recording.events
    chosen = np.zeros(problem.grid.mask.shape, bool)
    chosen.ravel()[problem.pixel[row]] = True
    keep = chosen[events.y, events.x]
    parts = {name: getattr(events, name)[keep] for name in ("x", "y", "p", "t")}
    return replace(recording, events=replace(events, **parts))


def _pairs(recording: Recording, problem: Problem, row: np.ndarray) -> PairData:
    """Pair the events of some pixels of a problem."""
    known = problem.pairs
    Float, UInt32 = type(known.phases), type(known.offset)
    pairs = pair_events(recording)
    count = np.diff(pairs.offset.astype(np.int64))[problem.pixel[row]]
    return PairData(
        offset=UInt32(np.append(0, np.cumsum(count)).astype(np.uint32)),
        phases=Float(pack_phases(pairs.phase_start, pairs.phase_end, pairs.polarity)),
        threshold_on=Float(known.threshold_on.numpy()[row]),
        threshold_off=Float(known.threshold_off.numpy()[row]),
        slot_leds=UInt32(pack_slots(recording.schedule.order, problem.illumination.n_led)),
    )
