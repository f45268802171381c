"""Try several readings of the same events on a few pixels, all in one solve."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.events.pairs import pair_events
from evsdr.events.photoreceptor import Photoreceptors
from evsdr.model.arrays import owned
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing
from evsdr.records import Recording
from evsdr.solve import loop
from evsdr.solve.grid import lonely_grid
from evsdr.solve.loop import data_of, start_of
from evsdr.solve.pair_data import PairData, pack_phases, pack_slots, thin
from evsdr.solve.problem import Problem
from evsdr.solve.recipes import Effort, trial
from evsdr.solve.solution import Solution
from evsdr.solve.unknowns import first_theta

N_HEARD, N_MOST = 40, 48  # events of a pixel that count in the search, and at all
FINE = np.linspace(-0.6, 0.6, 7)  # around the best candidate, relative to the distance of its neighbours


def costs(cases: list[PairData], light: Illumination, pixel: np.ndarray, thresholds: bool) -> np.ndarray:
    """Fit each reading and give its cost: arguments as of `solve`.

    Returns
    -------
    (n_case, n_pixel) float32
        Negative logarithm of the robust likelihood, up to a constant.
    """
    return solve(cases, light, pixel, thresholds).cost.reshape(len(cases), -1)


def solve(cases: list[PairData], light: Illumination, pixel: np.ndarray, thresholds: bool) -> Solution:
    """Fit each reading.

    Parameters
    ----------
    cases : list of PairData
        Pairs of the chosen pixels only, each with its own table of slots; tables are equally long.
    light : Illumination
        Of all pixels.
    pixel : (n_pixel,) or (n_case, n_pixel) int
        The chosen ones, in `light`.
    thresholds : bool
        Whether each pixel's thresholds are unknown.

    Returns
    -------
    Solution
        Pixels of one reading after those of another.
    """
    Float, UInt32 = type(cases[0].phases), type(cases[0].offset)
    n_slot = dr.width(cases[0].slot_leds)
    phases, counts = [], []
    for i, case in enumerate(cases):
        own = case.phases.numpy().reshape(-1, 2)
        away = n_slot * i  # slots of a case lie behind those of the one before
        phases.append(own + away * np.stack([np.ones(len(own)), np.sign(own[:, 1])], axis=-1))
        counts.append(case.counts)
    pixel = np.broadcast_to(pixel, (len(cases), np.shape(pixel)[-1])).ravel()
    n_pixel = len(pixel)

    def together(arrays, kind):
        return owned(kind, np.concatenate([a.numpy() for a in arrays]))

    tried = PairData(
        offset=owned(UInt32, np.append(0, np.cumsum(np.concatenate(counts)))),
        phases=owned(Float, np.concatenate(phases).ravel()),
        threshold_on=together([case.threshold_on for case in cases], Float),
        threshold_off=together([case.threshold_off for case in cases], Float),
        slot_leds=together([case.slot_leds for case in cases], UInt32),
    )
    there = light.gather(owned(UInt32, pixel))
    grid, width = lonely_grid(n_pixel, UInt32), Effort().width(thresholds)
    data = data_of(LambertianRing(there), thin(tried, N_MOST), light.constant_light, grid, width)
    frontal = np.tile([0.0, 0.0, 1.0], (n_pixel, 1))
    start = start_of(data, first_theta(frontal, light.n_band, thresholds, Float), N_HEARD)
    return loop.solve(data, trial(), start)


# ---------------------------------------------------------------------- other readings of the events


def of_recording(recording: Recording, problem: Problem, row: np.ndarray) -> Recording:
    """Keep the events of some pixels of a problem."""
    events = recording.events
    chosen = np.zeros(problem.grid.mask.shape, bool)
    chosen.ravel()[problem.pixel[row]] = True
    keep = chosen[events.y, events.x]
    parts = {name: getattr(events, name)[keep] for name in ("x", "y", "p", "t")}
    return replace(recording, events=replace(events, **parts))


def read(
    few: Recording, problem: Problem, row: np.ndarray, receptors: Photoreceptors | None = None
) -> PairData:
    """Pair the events of some pixels of a problem anew; `few` is their recording, maybe put right."""
    known = problem.pairs
    Float, UInt32 = type(known.phases), type(known.offset)
    pairs = pair_events(few, None, receptors)
    count = np.diff(pairs.offset.astype(np.int64))[problem.pixel[row]]
    return PairData(
        offset=owned(UInt32, np.append(0, np.cumsum(count))),
        phases=owned(Float, pack_phases(pairs.phase_start, pairs.phase_end, pairs.polarity)),
        threshold_on=owned(Float, known.threshold_on.numpy()[row]),
        threshold_off=owned(Float, known.threshold_off.numpy()[row]),
        slot_leds=owned(UInt32, pack_slots(few.schedule.order, problem.illumination.n_led)),
    )


@dataclass(frozen=True)
class Smallest:
    """The number of smallest cost, one standard deviation, and by how much the first candidate costs more."""

    value: float
    sigma: float
    gain: float


def search_scalar(
    costs: Callable[[np.ndarray], np.ndarray], candidates: np.ndarray, n_refine: int = 1
) -> Smallest:
    """Find the number, 0 or more, of smallest cost.

    Parameters
    ----------
    costs : callable (n,) -> (n,)
        Negative logarithm of the likelihood of each number, up to a constant.
    candidates : (n,) float
        Growing; the best of them is refined by the vertex of a parabola.
    n_refine : int
        Parabolas, one narrower than the other.
    """
    candidates = np.asarray(candidates, float)
    cost = costs(candidates)
    best = int(np.argmin(cost))
    step = np.diff(candidates[max(best - 1, 0) : best + 2]).max(initial=0.0)
    around = np.clip(best - 1, 0, max(len(candidates) - 3, 0)) + np.arange(min(3, len(candidates)))
    value, sigma = _vertex(candidates[around], cost[around]) or (candidates[best], step)
    centre = candidates[best]
    for _ in range(n_refine if step else 0):
        fine = np.unique(np.clip(centre + step * FINE, 0, None))
        vertex = _vertex(fine, costs(fine))
        if vertex is None:  # few and contrary events: the coarse ones have to do
            break
        (value, sigma), step = vertex, step / 3
        centre = value
    return Smallest(float(value), float(sigma), float(cost[0] - cost[best]))


def _vertex(x: np.ndarray, cost: np.ndarray) -> tuple[float, float] | None:
    """Give the vertex of the parabola through costs and its standard deviation; None if it has no bottom."""
    if len(x) < 3:
        return None
    _, slope, bend = np.polynomial.Polynomial.fit(x, cost, 2).convert().coef
    if bend <= 0:
        return None
    return float(np.clip(-0.5 * slope / bend, x[0], x[-1])), float((2 * bend) ** -0.5)
