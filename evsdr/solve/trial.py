"""Try several readings of the same events on a few pixels, all in one solve."""

from dataclasses import dataclass

import drjit as dr
import numpy as np

from evsdr.model.arrays import columns, owned
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing
from evsdr.solve import loop
from evsdr.solve.grid import lonely_grid
from evsdr.solve.loop import data_of, start_of
from evsdr.solve.loss import residuals
from evsdr.solve.pair_data import PairData, bounds, thin
from evsdr.solve.recipes import Effort, trial
from evsdr.solve.solution import Data, Solution
from evsdr.solve.unknowns import first_theta

N_HEARD, N_MOST = 40, 48  # events of a pixel that count in the search, and at all


@dataclass(frozen=True)
class Reading:
    """What one reading makes of the chosen pixels.

    Attributes
    ----------
    theta : (n_pixel, 2 + n_band) float32
        Slopes and log reflectances.
    pixel : (n_pair,) int
        The pixel of each pair that counted, by its place among the chosen ones.
    residual : (n_pair,) float32
        What remains of its threshold, relative.
    gain : (n_pixel, 2) float32, optional
        Estimated factors on the told C_on and C_off.
    """

    theta: np.ndarray
    pixel: np.ndarray
    residual: np.ndarray
    gain: np.ndarray | None


def readings(
    cases: list[PairData], light: Illumination, pixel: np.ndarray, thresholds: bool
) -> list[Reading]:
    """Fit each reading and give what it leaves unexplained; arguments as of `solve`."""
    data, solution = _solve(cases, light, pixel, thresholds)
    n, gain = len(cases), solution.threshold_gain
    gains = None if gain is None else columns(type(data.constant_light), gain)
    u = residuals(data.model, data.pairs, data.constant_light, solution.theta, gains).numpy()
    counts = data.pairs.counts.reshape(n, -1)
    own = np.split(u, np.cumsum(counts.sum(axis=1))[:-1])
    of_pixel = [np.repeat(np.arange(len(count)), count) for count in counts]
    given = [None] * n if gain is None else np.split(gain, n)
    return [Reading(*parts) for parts in zip(np.split(solution.theta, n), of_pixel, own, given)]


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
    return _solve(cases, light, pixel, thresholds)[1]


def _solve(cases, light, pixel, thresholds: bool) -> tuple[Data, Solution]:
    Float, UInt32 = type(cases[0].phases), type(cases[0].first)
    n_slot = dr.width(cases[0].slot_leds)
    phases, counts = [], []
    cases = [thin(case.events, N_MOST) for case in cases]
    for i, case in enumerate(cases):
        own = case.phases.numpy().reshape(-1, 2)
        away = n_slot * i  # slots of a case lie behind those of the one before
        phases.append(own + away * np.stack([np.ones(len(own)), np.sign(own[:, 1])], axis=-1))
        counts.append(case.counts)
    pixel = np.broadcast_to(pixel, (len(cases), np.shape(pixel)[-1])).ravel()
    n_pixel = len(pixel)

    def together(arrays, kind):
        return owned(kind, np.concatenate([a.numpy() for a in arrays]))

    first, last = bounds(np.append(0, np.cumsum(np.concatenate(counts))), UInt32)
    tried = PairData(
        first=first,
        last=last,
        phases=owned(Float, np.concatenate(phases).ravel()),
        threshold_on=together([case.threshold_on for case in cases], Float),
        threshold_off=together([case.threshold_off for case in cases], Float),
        slot_leds=together([case.slot_leds for case in cases], UInt32),
    )
    there = light.gather(owned(UInt32, pixel))
    grid, width = lonely_grid(n_pixel, UInt32), Effort().width(thresholds)
    data = data_of(LambertianRing(there), tried, light.constant_light, grid, width)
    frontal = np.tile([0.0, 0.0, 1.0], (n_pixel, 1))
    start = start_of(data, first_theta(frontal, light.n_band, thresholds, Float), N_HEARD)
    return data, loop.solve(data, trial(), start)
