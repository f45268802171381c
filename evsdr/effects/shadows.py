"""Cast shadows: on the scene's geometry, on the surface of a fit, or as the events tell them."""

from dataclasses import replace

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.sensitivity import Look, against, mean_error
from evsdr.effects.world import SURE, TRIAL_RAYS, Fitted, World
from evsdr.model.illumination import Illumination
from evsdr.solve.noise import MISFIT

# Share of the suspects' misfit that hidden LEDs must explain; measured: 0.43 to 0.84 in shadows, 0.28 where gloss is not
# modelled, 0.05 and less where the model is right
EXPLAINED = 0.35
TURNED = "; then found to be gloss in "
FACING = 0.05  # cosine from which a surface that faces an LED should be lit
ASKED = {
    "off": "not modelled: asked for by --shadows off",
    "downweight": "down-weighted: asked for by --shadows downweight",
    "scene": "traced on the scene's geometry: asked for by --shadows scene",
    "estimate": "traced on the estimated depth: asked for by --shadows estimate",
}


class Shadows:
    """Shadows of known shapes on each other and on themselves."""

    name, option, when = "cast shadows", "shadows", "scene"

    def decide(self, asked: str, world: World, fitted: Fitted | None) -> Decision | None:
        """Trace them at pixel centres, where the normals are: others may lie behind the horizon."""
        if asked not in ("auto", "latent"):
            return Decision(self.name, asked == "scene", ASKED[asked])
        if not world.ring.shape_is_known:
            return None
        plain, centres = world.trace(False, TRIAL_RAYS), world.trace(True, 1)
        return _decision(world, world.look(), plain, centres, "the scene's geometry")

    def model(self, world: World, decision: Decision) -> World:
        """Trace them on the scene's geometry."""
        return replace(world, shadows="scene")


class ShadowsOnFit:
    """Shadows on the surface of the fit, where they are asked for."""

    name, option, when = "cast shadows", "shadows", "together"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Trace them on the surface of the fit."""
        if asked != "estimate":
            return None
        plain, shadowed = world.trace(False, TRIAL_RAYS, fitted), world.trace(True, 1, fitted, SURE)
        return Decision(self.name, True, ASKED[asked], mean_error(world.look(fitted), plain, shadowed))

    def model(self, world: World, decision: Decision) -> World:
        """Trace them on the surface of the fit, whenever it changes."""
        return replace(world, shadows="estimate")


class ShadowsInEvents:
    """Shadows that no geometry tells, or tells wrong: what each pixel sees of the LEDs is an unknown."""

    name, option, when = "cast shadows", "shadows", "together"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Ask the events of pixels that the maps explain badly; what is traced is their prior."""
        if asked not in ("auto", "latent"):
            return None
        if world.terms.solver == "adam":
            return self._left_out(world, "the solver adam asks no events for them")
        if world.metal is not None:
            return self._left_out(world, "not looked for on metal")
        if asked == "auto" and fitted.solution.noise > MISFIT:  # what is wrong is not what some pixels see
            return self._left_out(world, "events and model contradict each other")
        if asked == "auto" and not world.terms.thorough and world.ring.shape_is_known:
            return self._left_out(world, "the preset fast believes a known shape")
        seen, limit = world.seen(fitted), world.terms.limit_deg
        traced = self.name in world.decisions and world.decisions[self.name].modelled
        n_changed = np.count_nonzero(seen.gain)
        if n_changed == 0 and asked == "auto":
            return self._left_out(world, "the events show none")
        look, light = world.look(fitted), self.model(world).illumination(fitted)
        error = mean_error(look, world.illumination(fitted), light)
        share = blocked_share(look, world.trace(False, TRIAL_RAYS), light)
        modelled = asked == "latent" or (error > limit and seen.explained > EXPLAINED)
        if traced and not modelled:
            return None
        found = f"{share:.2%} of the (pixel, LED) pairs that face each other are hidden, as events tell in {n_changed} pixels"
        why = f"{'found' if modelled else 'not modelled'}: {found}; {against(error, error > limit, limit)}"
        if not modelled and error > limit:
            why += f", but it explains only {seen.explained:.0%} of what is wrong there"
        return Decision(self.name, modelled, why, error, {"blocked": share, "pixels": n_changed}, seen)

    def _left_out(self, world: World, why: str) -> Decision | None:
        """Say why, unless the scene's geometry has told already."""
        return None if self.name in world.decisions else Decision(self.name, False, f"not modelled: {why}")

    def model(self, world: World, decision: Decision | None = None) -> World:
        """Ask whenever maps or surface have changed."""
        return replace(world, shadows="latent")


class ShadowsOrGloss:
    """Shadows that were found before lobes were: some were lobes."""

    name, option, when = "cast shadows", "shadows", "settled"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Count the pixels that see all LEDs again, see `World.seen`."""
        if world.shadows != "latent" or world.gloss is None:
            return None
        before, now = (share < 1 for share in (fitted.problem.visible, world.seen(fitted).share))
        n_lobe = np.count_nonzero(before.any(axis=0) & ~now.any(axis=0))
        if n_lobe == 0:
            return None
        so_far = world.decisions[self.name]
        n_lobe += so_far.found.get("gloss", 0)
        why = f"{so_far.why.partition(TURNED)[0]}{TURNED}{n_lobe} pixels"
        return replace(so_far, why=why, modelled=bool(now.any()), found=so_far.found | {"gloss": n_lobe})

    def model(self, world: World, decision: Decision) -> World:
        """Leave it to what pixels see."""
        return world


def _decision(
    world: World, look: Look, plain: Illumination, shadowed: Illumination, geometry: str
) -> Decision:
    """Decide by what shadows would change, and say so."""
    error, share = mean_error(look, plain, shadowed), blocked_share(look, plain, shadowed)
    modelled, found = error > world.terms.limit_deg, {"blocked": share}
    if not modelled and share == 0:
        why = f"not modelled: no (pixel, LED) pair that faces each other is blocked on {geometry}"
        return Decision(Shadows.name, False, why, error, found)
    blocked = f"{share:.2%} of the (pixel, LED) pairs that face each other are blocked on {geometry}"
    what = f"traced on {geometry}" if modelled else "not modelled"
    why = f"{what}: {blocked}; {against(error, modelled, world.terms.limit_deg)}"
    return Decision(Shadows.name, modelled, why, error, found)


def blocked_share(look: Look, plain: Illumination, shadowed: Illumination) -> float:
    """Give the share of (pixel, LED) that face each other yet are blocked."""
    direction, irradiance = look.light(plain)
    faces = (np.einsum("jnk,nk->jn", direction, look.normal) > FACING) & (irradiance > 0)
    visible = look.light(shadowed)[1] / np.where(irradiance > 0, irradiance, 1)
    return float(np.sum((1 - np.minimum(visible, 1))[faces]) / max(np.count_nonzero(faces), 1))
