"""What may be but is not modelled, or is shared and left open: named, and paid for in sigma."""

from dataclasses import replace

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.shared import last_found
from evsdr.effects.world import Fitted, World
from evsdr.records import Maps
from evsdr.solve.shared.infer import less_sure
from evsdr.solve.shared.rig import Basis
from evsdr.solve.unknowns import KNOWN_SCALE, log_spread


def paid(maps: Maps, decisions: dict[str, Decision]) -> Maps:
    """Let all decisions pay whose answer does, by `pay(maps) -> maps`."""
    for decision in decisions.values():
        pay = getattr(decision.answer, "pay", None)
        maps = pay(maps) if pay else maps
    return maps


def wider(maps: Maps, turn_deg: np.ndarray | float, log_reflectance: np.ndarray | float) -> Maps:
    """Add to the sigmas of known pixels what normals [deg] and logarithms of reflectances may be off by.

    Parameters
    ----------
    maps : Maps
    turn_deg : (height, width) float, or float
    log_reflectance : (height, width, n_band) float, or fewer of these axes
    """
    change, turn = log_reflectance * maps.reflectance, turn_deg * maps.mask
    return replace(
        maps,
        normal_sigma_deg=np.hypot(maps.normal_sigma_deg, turn, dtype=np.float32),
        reflectance_sigma=np.minimum(np.hypot(maps.reflectance_sigma, change, dtype=np.float32), 1),
    )


def widened(fitted: Fitted, world: World) -> Maps:
    """Add to the sigmas of maps what is left open of what pixels share, and what of it the events want but do not tell."""
    found = last_found(world.decisions)
    if not found:
        return fitted.maps
    inferred, apart = found.inferred, thresholds_apart(fitted, world)
    if apart.any():
        basis = Basis.of(found.names, fitted.problem.illumination.band)
        by = np.zeros(len(basis.owner))
        by[basis.owner == "thresholds"] = apart
        inferred = less_sure(inferred, by, basis)
    open_deg, of_logs = np.hypot(inferred.normal_sigma_deg, found.untold_deg), inferred.log_reflectance_sigma
    maps = fitted.maps
    if np.sqrt(np.mean(np.square(of_logs))) > KNOWN_SCALE:
        maps = replace(maps, mask_reflectance=np.zeros_like(maps.mask))
    return wider(maps, open_deg, log_spread(np.square(of_logs)))


def thresholds_apart(fitted: Fitted, world: World) -> np.ndarray:
    """Give how much larger mean thresholds of the maps are than those inferred, (2,) of C_on and C_off, of the logarithm.

    Both are learnt from the events, the ones with what neighbours tell of all pixels, the others with all else that pixels share:
    what of a pixel goes otherwise than its model moves them differently, so either may be as far off. 0 where either is told, and
    under lobes, as those inferred are of a matt surface.
    """
    found, prior = last_found(world.decisions), fitted.solution.threshold_prior
    if world.gloss is not None or not prior or not found or "thresholds" not in found.names:
        return np.zeros(2)
    return np.array(prior[:2]) - found.inferred.rig.log_threshold
