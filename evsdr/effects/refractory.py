"""The refractory period of a sensor, from events whose light is known but for a few maps."""

from dataclasses import replace

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.world import Fitted, World
from evsdr.records import Recording
from evsdr.solve import trial
from evsdr.solve.problem import Problem

N_PIXEL = 400  # pixels that tell it
CANDIDATES_US = (0.0, 10.0, 25.0, 50.0, 100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0)
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
    few = trial.of_recording(recording, problem, pixel)

    def costs(periods):
        sensors = [replace(few.sensor, refractory_us=float(period)) for period in periods]
        cases = [trial.read(replace(few, sensor=sensor), problem, pixel) for sensor in sensors]
        return trial.costs(cases, problem.illumination, pixel, thresholds).sum(axis=1)

    found = trial.search_scalar(costs, candidates, N_REFINE)
    return found.value, float(np.hypot(found.sigma, MODEL_SHARE * recording.schedule.slot_us))


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


class Refractory:
    """A refractory period that the recording does not tell, or tells wrong."""

    name, option, when = "refractory period", "refractory", "scene"

    def decide(self, asked: str, world: World, fitted: Fitted | None) -> Decision:
        """Estimate it where the recording does not tell it, or on demand."""
        sensor = world.recording.sensor
        told = None if "refractory_us" in sensor.guessed else sensor.refractory_us
        report = {"told_us": told, "found_us": None}
        if asked == "known" or (asked == "auto" and told is not None):
            why = "asked for by --refractory known" if asked == "known" else "the recording tells it"
            return Decision(self.name, False, f"as told: {why}", found={"refractory_us": report})
        found = find_refractory(world.recording, world.problem(), world.thresholds)
        if found is None:
            return Decision(
                self.name, False, "as told: too few pixels tell it", found={"refractory_us": report}
            )
        report |= {"found_us": found[0], "sigma_us": found[1]}
        because = "asked for by --refractory estimate" if asked == "estimate" else "the recording tells none"
        why = f"estimated, {found[0]:.3g} +- {found[1]:.2g} us: {because}"
        return Decision(self.name, True, why, None, {"refractory_us": report}, found[0])

    def model(self, world: World, decision: Decision) -> World:
        """Pair events by it."""
        sensor = replace(world.recording.sensor, refractory_us=decision.answer)
        return replace(world, recording=replace(world.recording, sensor=sensor))
