"""How well each hypothesis on a set-up explains the events of some pixels, and which normals it gives them."""

import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from evsdr.effects.hypotheses import Hypothesis
from evsdr.errors import InputError
from evsdr.events.chosen import count_events, events_of
from evsdr.events.pairs import pair_events
from evsdr.model.illumination import Illumination
from evsdr.solve import trial
from evsdr.solve.pair_data import PairData
from evsdr.solve.problem import lay_out
from evsdr.solve.unknowns import to_normal

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World

N_TRIED, ENOUGH = 100, 50  # pixels on which each hypothesis is tried, at most and preferably
MOST_AT_ONCE = 6000  # pixels of all hypotheses that are solved together
HALF = 0.5
MANY_HOT = 0.5  # of the pixels: it is the clock that is wrong then
SCALES = np.geomspace(0.005, 2.0, 61)  # of residuals that are tried


@dataclass(frozen=True)
class Trial:
    """What one hypothesis makes of the chosen pixels.

    Attributes
    ----------
    cost : float
        Of an event pair: negative log likelihood under Cauchy's law with the scale that fits best.
    scale : float
        That scale: the share of a threshold that stays unexplained.
    residual : (n_pair,) float
    place : (n_pixel,) int
        Where the pixels then lie in the image, row-major.
    normal : (n_pixel, 3) float
    gain : (n_pixel, 2) float, optional
        Factors on the told C_on and C_off, where they are unknown.
    """

    cost: float
    scale: float
    residual: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    gain: np.ndarray | None

    @property
    def lost(self) -> float:
        """Give the share of the events of which half or more of a threshold stays unexplained."""
        return float(np.mean(np.abs(self.residual) > HALF))


def cauchy(u: np.ndarray) -> tuple[float, float]:
    """Give the least cost of a residual (n,) under Cauchy's law, and the scale that has it."""
    costs = [np.log(s) + np.mean(np.log1p((u / s) ** 2)) for s in SCALES]
    best = int(np.argmin(costs))
    return float(costs[best]), float(SCALES[best])


def chosen(world: "World", fitted: "Fitted", moves: list, n: int = N_TRIED) -> np.ndarray:
    """Choose pixels of a fit, by their place in the image, that fire more events than there are unknowns; if possible
    such that stay on the object however `moves` turn the image."""
    mask = fitted.problem.grid.mask
    count = count_events(world.recording.events, mask.shape)
    rich = mask & (count > fitted.solution.theta.shape[1])
    if world.hot is not None and world.hot[mask].mean() < MANY_HOT:
        rich &= ~world.hot
    staying = rich.copy()
    for move in moves:
        moved = np.zeros(mask.size, bool)
        moved[move(np.arange(mask.size).reshape(mask.shape)).ravel()] = mask.ravel()
        staying &= moved.reshape(mask.shape)
    pixel = np.flatnonzero(staying if np.count_nonzero(staying) >= ENOUGH else rich)
    return np.sort(np.random.default_rng(0).permutation(pixel)[:n])


def try_all(
    world: "World",
    fitted: "Fitted",
    pixel: np.ndarray,
    hypotheses: list[Hypothesis | None],
    light: Illumination | None = None,
) -> dict[Hypothesis | None, Trial]:
    """Fit some pixels under each hypothesis, None is what is told, in the light of the fit or another of the whole image.

    Hypotheses under which no events pair, or pixels lie outside the object, are left out; what is told then explains
    nothing.
    """
    sample, problem, image = of_pixels(world, pixel), fitted.problem, light
    groups: dict = {}
    for h in hypotheses:
        believed = h.mend(sample) if h else sample
        case = _case(believed, problem)
        if case is not None:
            groups.setdefault((believed.thresholds, believed.veil), []).append((h, *case))
    out, most = {}, max(1, MOST_AT_ONCE // len(pixel))
    for (thresholds, veil), group in groups.items():
        light = problem.illumination
        if image is not None:
            light = replace(image, constant_light=light.constant_light)
        if veil is not None:
            light = replace(light, constant_light=dr.opaque(type(light.constant_light), veil))
        for k in range(0, len(group), most):
            hs, cases, places = zip(*group[k : k + most])
            row = np.searchsorted(problem.pixel, places) if image is None else np.array(places)
            readings = trial.readings(list(cases), light, row, thresholds)
            for h, place, read in zip(hs, places, readings):
                normal = to_normal(read.theta.astype(float))
                out[h] = Trial(*cauchy(read.residual), read.residual, place, normal, read.gain)
    if None in hypotheses and None not in out:
        nothing = np.ones(1)
        out[None] = Trial(*cauchy(nothing), nothing, pixel, np.tile([0.0, 0.0, 1.0], (len(pixel), 1)), None)
    return out


def of_pixels(world: "World", pixel: np.ndarray) -> "World":
    """Keep the events of some pixels only."""
    recording, sensor = world.recording, world.recording.sensor
    kept = np.zeros((sensor.height, sensor.width), bool)
    kept.ravel()[pixel] = True
    return replace(world, recording=replace(recording, events=events_of(recording.events, kept)))


def _case(world: "World", problem) -> tuple[PairData, np.ndarray] | None:
    """Pair the events of a world that has few; None if none pair, or pixels leave those of the problem."""
    recording, light = world.recording, problem.illumination
    events, sensor = recording.events, recording.sensor
    mask = np.zeros((sensor.height, sensor.width), bool)
    mask[events.y, events.x] = True
    place = np.flatnonzero(mask)
    if not np.isin(place, problem.pixel).all():
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            pairs = pair_events(recording, mask)
    except InputError:
        return None
    return lay_out(recording, pairs, mask, light), place
