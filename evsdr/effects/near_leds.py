"""LEDs at finite distance: whether direction and fall-off are per pixel, and from which surface."""

from dataclasses import replace

from evsdr.effects.effect import Decision
from evsdr.effects.sensitivity import against, mean_error
from evsdr.effects.shared import REACH, SharedEffect, SharedFound
from evsdr.effects.world import TRIAL_RAYS, Fitted, World

UNASKED = (
    "how far the surface is from the LEDs was taken from the rectangle that stands for it, and errors may be larger than sigmas "
    "say: the events did not tell it; measure it, and put the rectangle there."
)
# Measured (experiments.near_leds by `fast`): a blob 0.370 +- 0.015 for 0.542, 2.8 degrees, a sphere 0.724 +- 0.012 for 0.698, 0.45
ASKED_EARLY = (
    "how far the surface is from the LEDs was inferred from first maps, and errors may be larger than sigmas say: the preset "
    "balanced infers it from better ones."
)
STILL_MOVES = (
    "when light was traced on the fitted surface its distance from the LEDs moved by {:.2g} scene units, which turns normals by {:.2g} degrees, "
    "and may move as much again; measure it, and put the rectangle there."
)
HARDLY_TOLD = (
    "events tell hardly better than the rectangle how far the surface is from the LEDs: {:.2g} scene units either way turn normals by {:.2g} "
    "degrees; measure it, and put the rectangle there."
)
STILL_DEG = 1.0  # by which normals still turn where that is doubtful; guessed
AT_THE_END = 0.98  # of how far a surface is looked for; guessed
NEAR, FAR = "near: direction and fall-off per pixel", "far: one direction for all pixels"


class NearLeds:
    """Direction and fall-off per pixel, on the scene's geometry or its placeholder."""

    name, option, when = "LEDs", "leds", "scene"

    def decide(self, asked: str, world: World, fitted: Fitted | None) -> Decision:
        """Compare near light with the best far one."""
        leds, look = world.ring.leds, world.look()
        count = f"{leds.n_led} in {leds.n_band} bands"
        if not world.ring.is_near:
            return Decision(self.name, False, f"{count}, {FAR}")
        if asked != "auto" or len(look.pixel) == 0:
            near = asked != "far"
            why = f"{count}, {NEAR if near else FAR}: asked for by --leds {asked}"
            return Decision(self.name, near, why)
        light = self.model(world).trace(False, TRIAL_RAYS)
        error, limit = mean_error(look, light.far(light, look.pixel), light), world.terms.limit_deg
        near = error > limit
        why = f"{count}, {NEAR if near else FAR}; parallax {against(error, near, limit)}"
        return Decision(self.name, near, why, error)

    def model(self, world: World, decision: Decision | None = None) -> World:
        """Trace direction and fall-off at each pixel."""
        return replace(world, near=True)


class DistanceOfNearLeds(SharedEffect):
    """How far near LEDs are from an unknown shape: a rectangle stands for it, somewhere in it or beside it."""

    name, group = "distance of the surface", "distance"
    untold = "no LED is near to a surface of unknown shape"

    def decide(self, asked, world: World, fitted: Fitted) -> Decision | None:
        """Take what the events tell; where none were asked though all hangs on it, or from first maps only, that is doubtful."""
        decision = super().decide(asked, world, fitted)
        if self.group not in world.terms.shared or not world.distance_is_unknown:
            return decision
        if not decision.answer:
            return replace(decision, doubt=UNASKED)
        if not world.terms.thorough:
            return replace(decision, doubt=ASKED_EARLY)
        off = decision.answer.distance_off
        if off.turns_deg <= STILL_DEG:
            return decision
        words = STILL_MOVES if off.moving > off.vague else HARDLY_TOLD
        return replace(decision, doubt=words.format(off.by, off.turns_deg))

    def say(self, found: SharedFound) -> str:
        """Give the distance."""
        by, sigma = self._found(found)
        return f"{abs(by):.3g} +- {sigma:.2g} scene units {'nearer to' if by >= 0 else 'farther from'} the camera than the rectangle"

    def warning(self, found: SharedFound) -> str:
        """Give the distance, if it ends where nothing farther was looked for."""
        if abs(self._found(found)[0]) < AT_THE_END * REACH * found.told.distance:
            return ""
        words = f"the surface is {self.say(found)} that stands for it, or more"
        return f"{words}; measure how far it is from the LEDs, and put the rectangle there."

    def numbers(self, found: SharedFound) -> dict:
        """Give it in numbers."""
        return dict(zip(("nearer", "nearer_sigma"), self._found(found)))

    def model(self, world: World, decision: Decision) -> World:
        """Put it there."""
        return replace(world, nearer=self._found(decision.answer)[0])

    @staticmethod
    def _found(found: SharedFound) -> tuple[float, float]:
        return found.inferred.rig.distance, found.inferred.sigma.distance


class DepthOfNearLeds:
    """Near LEDs over an unknown shape: whether it matters that they are near to the surface of the fit."""

    name, option, when = "LEDs", "shadows", "together"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Compare light on the placeholder with that on the surface of the fit."""
        if not world.near or (world.ring.shape_is_known and asked != "estimate"):
            return None
        there = world.trace(False, TRIAL_RAYS, fitted)
        error, limit = mean_error(world.look(fitted), world.illumination(), there), world.terms.limit_deg
        moved = error > limit
        where = "estimated depth" if moved else "placeholder's depth"
        why = f"{world.decisions[self.name].why}; on the {where}: the other, {against(error, moved, limit)}"
        return Decision(self.name, moved, why, error)

    def model(self, world: World, decision: Decision) -> World:
        """Trace light on the surface of the fit."""
        return replace(world, moved=True)
