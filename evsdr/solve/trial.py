"""Try several readings of the same events on a few pixels, all in one solve."""

from dataclasses import replace

import drjit as dr
import numpy as np

from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing
from evsdr.solve import levenberg
from evsdr.solve.grid import NEXT, Grid
from evsdr.solve.pair_data import PairData

QUICK = replace(levenberg.PRESETS["fast"], silence=False, priors=None, n_sweep=0, n_final=8)


def of_pixels(pairs: PairData, pixel: np.ndarray) -> PairData:
    """Keep the pairs of some pixels."""
    Float, UInt32 = type(pairs.phases), type(pairs.offset)
    offset = pairs.offset.numpy().astype(np.int64)
    k = np.concatenate([np.arange(offset[i], offset[i + 1]) for i in pixel])
    return PairData(
        offset=UInt32(np.append(0, np.cumsum(np.diff(offset)[pixel])).astype(np.uint32)),
        phases=Float(pairs.phases.numpy().reshape(-1, 2)[k].ravel()),
        threshold_on=Float(pairs.threshold_on.numpy()[pixel]),
        threshold_off=Float(pairs.threshold_off.numpy()[pixel]),
        slot_leds=pairs.slot_leds,
    )


def costs(cases: list[PairData], light: Illumination, pixel: np.ndarray, thresholds: bool) -> np.ndarray:
    """Fit each reading and give its cost: arguments as of `solve`.

    Returns
    -------
    (n_case, n_pixel) float32
        Negative logarithm of the robust likelihood, up to a constant.
    """
    return solve(cases, light, pixel, thresholds).cost.reshape(len(cases), -1)


def solve(
    cases: list[PairData], light: Illumination, pixel: np.ndarray, thresholds: bool
) -> levenberg.Solution:
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
    levenberg.Solution
        Pixels of one reading after those of another.
    """
    Float, UInt32 = type(cases[0].phases), type(cases[0].offset)
    n_slot = dr.width(cases[0].slot_leds)
    phases, counts = [], []
    for i, case in enumerate(cases):
        own = case.phases.numpy().reshape(-1, 2)
        away = n_slot * i  # slots of a case lie behind those of the one before
        phases.append(own + away * np.stack([np.ones(len(own)), np.sign(own[:, 1])], axis=-1))
        counts.append(np.diff(case.offset.numpy().astype(np.int64)))
    pixel = np.broadcast_to(pixel, (len(cases), np.shape(pixel)[-1])).ravel()
    n_pixel = len(pixel)

    def together(arrays, kind):
        return kind(np.concatenate([np.asarray(a) for a in arrays]))

    tried = PairData(
        offset=UInt32(np.append(0, np.cumsum(np.concatenate(counts))).astype(np.uint32)),
        phases=Float(np.concatenate(phases).astype(np.float32).ravel()),
        threshold_on=together([case.threshold_on.numpy() for case in cases], Float),
        threshold_off=together([case.threshold_off.numpy() for case in cases], Float),
        slot_leds=together([case.slot_leds.numpy() for case in cases], UInt32),
    )
    there = light.gather(UInt32(pixel.astype(np.uint32)))
    start = [dr.zeros(Float, n_pixel) for _ in range(2 + light.n_band + (2 if thresholds else 0))]
    for b in range(light.n_band):
        start[2 + b] += float(np.log(levenberg.REFLECTANCE_CENTRE))
    itself = {place: dr.arange(UInt32, n_pixel) for place in NEXT}
    nowhere = {place: dr.full(dr.mask_t(Float), False, n_pixel) for place in NEXT}
    alone = Grid(np.ones((1, n_pixel), bool), itself, nowhere)
    return levenberg.solve(LambertianRing(there), tried, light.constant_light, start, alone, QUICK)
