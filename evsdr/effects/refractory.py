"""The refractory period of a sensor, as the events tell it."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from evsdr.effects.effect import Decision
from evsdr.effects.shared import WARNED, SharedEffect, SharedFound, plus_minus

if TYPE_CHECKING:
    from evsdr.effects.world import World


class Refractory(SharedEffect):
    """A refractory period that the recording does not tell, or tells wrong."""

    name, group = "refractory period", "refractory"

    def say(self, found: SharedFound) -> str:
        """Give the period."""
        return plus_minus(found.us("refractory"))

    def warning(self, found: SharedFound) -> str:
        """Give the period, if it is more than can be off."""
        told, (value, sigma) = found.told_refractory_us, found.us("refractory")
        if abs(value - told) <= WARNED * math.hypot(found.told.refractory_us, sigma):
            return ""
        return f"refractory_us is told as {told:.3g} but the events say {value:.3g}; the latter was used: check it."

    def numbers(self, found: SharedFound) -> dict:
        """Give it in numbers."""
        value, sigma = found.us("refractory")
        return {"refractory_us": {"told_us": found.told_refractory_us, "found_us": value, "sigma_us": sigma}}

    def model(self, world: "World", decision: Decision) -> "World":
        """Pair events by it."""
        sensor = replace(world.recording.sensor, refractory_us=decision.answer.us("refractory")[0])
        return replace(world, recording=replace(world.recording, sensor=sensor))
