"""Light by way of other surfaces."""

from dataclasses import replace

from evsdr.effects.effect import Decision
from evsdr.effects.sensitivity import against, mean_error
from evsdr.effects.world import TRIAL_RAYS, Fitted, World

DIRECT, BOTH = "direct light only", "direct and indirect light"


class IndirectLight:
    """Light that other surfaces, or other parts of the object, send on."""

    name, option, when = "light paths", "light_paths", "together"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision:
        """Compare light with and without it, gathered from the surface of the fit."""
        if asked == "direct":
            return Decision(self.name, False, f"{DIRECT}: asked for by --light-paths direct")
        if asked == "auto" and world.ring.integrator.max_depth <= 1:
            return Decision(self.name, False, f"{DIRECT}: max_depth of the scene is 1")
        light = self.model(world).illumination(fitted, TRIAL_RAYS)
        error = mean_error(world.look(fitted), replace(light, indirect=None), light)
        if asked == "indirect":
            return Decision(self.name, True, f"{BOTH}: asked for by --light-paths indirect", error)
        limit = world.terms.limit_deg
        modelled = error > limit
        why = f"{BOTH if modelled else DIRECT}: indirect light, {against(error, modelled, limit)}"
        return Decision(self.name, modelled, why, error)

    def model(self, world: World, decision: Decision | None = None) -> World:
        """Gather it whenever light is traced on a fit."""
        return replace(world, indirect=True)

    def refuse(self, world: World) -> World:
        """Take it back: the events are explained worse with it."""
        why = f"{DIRECT}: with indirect light the events are explained worse"
        decision = replace(world.decisions[self.name], modelled=False, why=why)
        return replace(world, indirect=False, decisions=world.decisions | {self.name: decision})
