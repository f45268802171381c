"""The refractory period of a sensor, from events whose light is known but for a few maps."""

from dataclasses import replace

import numpy as np

from evsdr.effects.world import Observations
from evsdr.events.pairs import pair_events
from evsdr.model.illumination import Illumination
from evsdr.records import Recording
from evsdr.solve import trial
from evsdr.solve.pair_data import PairData, pack_phases, pack_slots
from evsdr.solve.problem import Problem

N_PIXEL = 400  # pixels that tell it
CANDIDATES_US = (0.0, 10.0, 25.0, 50.0, 100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0)
FINE = np.linspace(-0.6, 0.6, 7)  # around the best, relative to the distance of its neighbours
N_REFINE = 2
MODEL_SHARE = 0.005  # of a slot: how far the estimate was off on simulated scenes
FEWEST_EVENTS = 20  # of a pixel


def find_refractory(recording: Recording, problem: Problem, thresholds: bool) -> tuple[float, float] | None:
    """Estimate how long after an event the reference is memorised anew.

    What the light does in that time is lost. A wrong period scatters the residuals of a fit, so that its cost as
    a function of the period is smallest at the true one, and its curvature there tells how well it is known.

    Parameters
    ----------
    recording : Recording
        Events; its own refractory period is one of the candidates.
    problem : Problem
        What light the pixels get.
    thresholds : bool
        Whether contrast thresholds are unknown.

    Returns
    -------
    refractory_us, sigma_us : float
        Estimate and one standard deviation [us]; None if too few pixels fire.
    """
    counts = np.diff(problem.pairs.offset.numpy().astype(np.int64))
    pixel = np.random.default_rng(0).permutation(np.flatnonzero(counts >= FEWEST_EVENTS))[:N_PIXEL]
    pixel.sort()
    if len(pixel) < 20:
        return None
    shortest = _shortest_interval_us(recording, problem, pixel)
    told = recording.sensor.refractory_us
    candidates = sorted({c for c in (*CANDIDATES_US, told) if c <= max(shortest, told)} | {shortest})
    cost = _costs(candidates, recording, problem, pixel, thresholds)
    best = int(np.argmin(cost))
    below = candidates[best] - candidates[max(best - 1, 0)]
    above = candidates[min(best + 1, len(candidates) - 1)] - candidates[best]
    step, centre, sigma = max(below, above, 10.0), candidates[best], None
    for _ in range(N_REFINE):
        fine = np.unique(np.clip(centre + step * FINE, 0, None))
        cost = _costs(fine, recording, problem, pixel, thresholds)
        curve = np.polynomial.Polynomial.fit(fine, cost, 2).convert()
        if curve.coef[2] <= 0:
            return float(fine[np.argmin(cost)]), float(step)
        centre = float(np.clip(-0.5 * curve.coef[1] / curve.coef[2], fine[0], fine[-1]))
        sigma, step = float((2 * curve.coef[2]) ** -0.5), step / 3
    return centre, float(np.hypot(sigma, MODEL_SHARE * recording.schedule.slot_us))


def _costs(
    candidates, recording: Recording, problem: Problem, pixel: np.ndarray, thresholds: bool
) -> np.ndarray:
    """Give the cost of each period."""
    mask = np.zeros(problem.grid.mask.size, bool)
    mask[problem.pixel[pixel]] = True
    mask = mask.reshape(problem.grid.mask.shape)
    known = problem.pairs
    Float, UInt32 = type(known.phases), type(known.offset)
    light = problem.illumination
    cases = []
    for period in candidates:
        sensor = replace(recording.sensor, refractory_us=float(period))
        pairs = pair_events(replace(recording, sensor=sensor), mask)
        count = np.diff(pairs.offset.astype(np.int64))[problem.pixel[pixel]]
        cases.append(
            PairData(
                offset=UInt32(np.append(0, np.cumsum(count)).astype(np.uint32)),
                phases=Float(pack_phases(pairs.phase_start, pairs.phase_end, pairs.polarity)),
                threshold_on=Float(known.threshold_on.numpy()[pixel]),
                threshold_off=Float(known.threshold_off.numpy()[pixel]),
                slot_leds=UInt32(pack_slots(recording.schedule.order, light.n_led)),
            )
        )
    return trial.costs(cases, light, pixel, thresholds).sum(axis=1)


def _shortest_interval_us(recording: Recording, problem: Problem, pixel: np.ndarray) -> float:
    """Give the shortest time between events of a pixel: no refractory period is longer."""
    events = recording.events
    chosen = np.zeros(problem.grid.mask.size, bool)
    chosen[problem.pixel[pixel]] = True
    number = events.y.astype(np.int64) * problem.grid.mask.shape[1] + events.x
    keep = chosen[number]
    order = np.argsort(number[keep], kind="stable")
    number, t = number[keep][order], events.t[keep][order]
    interval = np.diff(t)[number[1:] == number[:-1]]
    return float(np.quantile(interval, 0.001))


def choose_refractory(
    asked: str, seen: Observations, light: Illumination, thresholds: bool
) -> tuple[Observations, dict]:
    """Decide which refractory period counts, and say why.

    Parameters
    ----------
    asked : str
        `known`, `estimate` or `auto`.
    seen : Observations
    light : Illumination
        What the LEDs send to the pixels.
    thresholds : bool
        Whether contrast thresholds are unknown, too.

    Returns
    -------
    seen : Observations
        Paired by the period that counts.
    report : dict
        Periods told and found [us], for the summary.
    """
    sensor = seen.recording.sensor
    told = None if "refractory_us" in sensor.guessed else sensor.refractory_us
    report = {"told_us": told, "found_us": None}
    if asked == "known" or (asked == "auto" and told is not None):
        return seen, report
    found = find_refractory(seen.recording, seen.under(light), thresholds)
    if found is None:
        return seen, report
    corrected = replace(seen.recording, sensor=replace(sensor, refractory_us=found[0]))
    return seen.corrected(corrected), report | {"found_us": found[0], "sigma_us": found[1]}
