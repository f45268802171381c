"""How many rays sample the visibility of the LEDs."""

from dataclasses import replace

from evsdr.effects.effect import Decision
from evsdr.effects.sensitivity import mean_error
from evsdr.effects.world import ROUND_RAYS, TRIAL_RAYS, Fitted, World

SHARE = 0.4  # of the limit of other effects: what may be left to chance
STEPS = (TRIAL_RAYS, 16, 64, 256)


class Rays:
    """As many as the chance of few demands."""

    name, option, when = "rays per pixel", "", "scene"

    def decide(self, asked: str, world: World, fitted: Fitted | None) -> Decision:
        """Tell the error of a few rays from two trials; stratified, it falls with their number to the power 3/4."""
        if world.shadows == "none":
            why = f"{TRIAL_RAYS}: for the object's outline; no visibility is sampled"
            return Decision(self.name, False, why, found={"rays": TRIAL_RAYS})
        trial, again = (world.trace(True, TRIAL_RAYS, seed=seed) for seed in (0, 1))
        error, limit = mean_error(world.look(), trial, again) / 2**0.5, SHARE * world.terms.limit_deg
        needed = TRIAL_RAYS * (error / limit) ** (4 / 3)
        rays = next((n for n in STEPS if n >= needed), STEPS[-1])
        why = f"{TRIAL_RAYS} leave {error:.2g} degrees to chance, {limit:g} are wanted"
        if rays > world.terms.most_rays:
            rays, why = world.terms.most_rays, f"{why}; the preset allows no more"
        return Decision(self.name, rays > TRIAL_RAYS, f"{rays}: {why}", error, {"rays": rays})

    def model(self, world: World, decision: Decision) -> World:
        """Trace with so many."""
        return replace(world, rays=decision.found["rays"])


class RaysOnFit(Rays):
    """On the surface of a fit as many as may be: few while light and surface change."""

    when = "together"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Take what the preset allows."""
        if not world.on_fit:
            return None
        rays = world.terms.most_rays
        why = f"{rays}: as many as the preset allows, {ROUND_RAYS} until light settled"
        return Decision(self.name, True, why, found={"rays": rays})
