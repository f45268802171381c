"""What may be but is not modelled, as the events do not tell it from what is: named, and paid for in sigma."""

from dataclasses import replace

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.records import Maps


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
