"""LEDs that shine otherwise than the scene tells: their powers and directions, as the events tell them."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.shared import WARNED, Aim, SharedEffect, SharedFound

if TYPE_CHECKING:
    from evsdr.effects.world import World


# Standard deviations, root mean square of all LEDs, from which powers are others than told; guessed. Measured: with 3 a glossy goathead under
# powers 10 % off (`experiments.draws`, 45) comes out at 8.9 degrees, with 2 at 4.6
CLEAR = 2.0


class LedPowers(SharedEffect):
    """Powers of LEDs, against the others of their band."""

    name, group = "LED powers", "powers"

    def is_clear(self, found: SharedFound) -> bool:
        """Look at all differences together."""
        off, sigma = found.inferred.rig.log_power, found.inferred.sigma.log_power
        return bool(np.sum(off**2) > CLEAR**2 * np.sum(sigma**2))

    def say(self, found: SharedFound) -> str:
        """Give the largest difference."""
        off = found.inferred.rig.log_power
        j = int(np.argmax(np.abs(off)))
        return f"LED {j} is {100 * np.expm1(off[j]):+.2g} % off, all {100 * np.std(off):.2g} % on average"

    def warning(self, found: SharedFound) -> str:
        """Give the largest difference, if it is more than powers can be off; or that other things can pass for such ones."""
        worst = float(np.abs(found.inferred.rig.log_power).max())
        if worst > WARNED * found.told.powers:
            return f"LED powers differ from the scene's by up to {100 * worst:.0f} %, {told_by(found, 'powers')}; calibrate them."
        if self.group in found.inferred.doubted:
            return (
                "the surface looks too much one way to tell LED powers from its tilt and its gloss, and powers other than told "
                f"were found (by up to {100 * worst:.0f} %); calibrate them, or record something round under the same ring."
            )
        return ""

    def numbers(self, found: SharedFound) -> dict:
        """Give all factors."""
        factor, sigma = np.exp(found.inferred.rig.log_power), found.inferred.sigma.log_power
        return {"power_factor": factor.tolist(), "power_factor_sigma": (factor * sigma).tolist()}

    def model(self, world: "World", decision: Decision) -> "World":
        """Trace light of these powers."""
        rig = decision.answer.inferred.rig
        tilt = world.aim.tilt if world.aim else np.zeros_like(rig.tilt)
        return replace(world, aim=Aim(rig.log_power, tilt))


class LedDirections(SharedEffect):
    """Directions of far LEDs, but for turns of the whole ring: those only tolerances tell from turned normals."""

    name, group = "LED directions", "directions"
    untold = "LEDs are near"

    def say(self, found: SharedFound) -> str:
        """Give the mean turn."""
        turn = turns_deg(found)
        return f"LEDs are {turn.mean():.2g} degrees off on average, {turn.max():.2g} at most"

    def warning(self, found: SharedFound) -> str:
        """Give the largest turn, if it is more than directions can be off."""
        worst = float(turns_deg(found).max())
        if worst <= WARNED * found.told.directions_deg:
            return ""
        return (
            f"LED directions differ from the scene's by up to {worst:.2g} degrees, {told_by(found, 'directions')}; "
            "measure where the LEDs are, and write it there."
        )

    def numbers(self, found: SharedFound) -> dict:
        """Give all turns [deg], along two axes across each direction."""
        rig, sigma = found.inferred.rig, found.inferred.sigma
        return {"tilt_deg": np.degrees(rig.tilt).tolist(), "tilt_sigma_deg": np.degrees(sigma.tilt).tolist()}

    def model(self, world: "World", decision: Decision) -> "World":
        """Trace light of these directions."""
        rig = decision.answer.inferred.rig
        power = world.aim.log_power if world.aim else np.zeros_like(rig.log_power)
        return replace(world, aim=Aim(power, rig.tilt))


def turns_deg(found: SharedFound) -> np.ndarray:
    """Give the angles [deg] by which LEDs are turned."""
    return np.degrees(np.linalg.norm(found.inferred.rig.tilt, axis=1))


def told_by(found: SharedFound, group: str) -> str:
    """Say that the events tell it, and whether they know it."""
    doubted = group in found.inferred.doubted
    return f"as the events tell{', which know them hardly better than told' if doubted else ''}"
