"""A leak: ON events of pixels at rest, as what their comparators see rises by itself.

It makes ON events early and OFF events late, the more the slower the light.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

from evsdr.effects.effect import Decision
from evsdr.effects.shared import SharedEffect, SharedFound

if TYPE_CHECKING:
    from evsdr.effects.world import World

CLEAR = 4.0  # standard deviations from which there is one


class Leak(SharedEffect):
    """A rise of what all comparators see."""

    name, group = "leak", "leak"

    def is_clear(self, found: SharedFound) -> bool:
        """Look at how far it is from none."""
        rise, sigma = per_second(found)
        return abs(rise) > CLEAR * sigma

    def say(self, found: SharedFound) -> str:
        """Give the rise."""
        rise, sigma = per_second(found)
        return f"log I seems to rise by {rise:.2g} +- {sigma:.2g} a second"

    def numbers(self, found: SharedFound) -> dict:
        """Give it in numbers."""
        return dict(zip(("leak_per_s", "leak_sigma_per_s"), per_second(found)))

    def model(self, world: "World", decision: Decision) -> "World":
        """Pair events by it."""
        return replace(world, leak=per_second(decision.answer)[0] * 1e-6)


def per_second(found: SharedFound) -> tuple[float, float]:
    """Give the rise of log I and its standard deviation [1/s]."""
    return tuple(of.leak * 1e6 / found.slot_us for of in (found.inferred.rig, found.inferred.sigma))
