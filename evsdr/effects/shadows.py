"""Cast shadows: on the scene's geometry, or on the surface of a fit where the shape is unknown."""

from dataclasses import replace

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.sensitivity import Look, against, mean_error
from evsdr.effects.world import TRIAL_RAYS, Fitted, World
from evsdr.model.arrays import owned
from evsdr.model.illumination import Illumination
from evsdr.solve import trial

FACING = 0.05  # cosine from which a surface that faces an LED should be lit
SURE = 0.5  # pixels: nearer hits may come of the noise of an estimated surface
N_TRIED = 300  # pixels whose events say whether shadows are there
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
        if asked != "auto":
            return Decision(self.name, asked == "scene", ASKED[asked])
        if not world.ring.shape_is_known:
            return None
        plain, centres = world.trace(False, TRIAL_RAYS), world.trace(True, 1)
        return _decision(world, world.look(), plain, centres, "the scene's geometry")

    def model(self, world: World, decision: Decision) -> World:
        """Trace them on the scene's geometry."""
        return replace(world, shadows="scene")


class ShadowsOnFit:
    """Shadows of an unknown shape on itself."""

    name, option, when = "cast shadows", "shadows", "together"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Trace them on the surface of the fit, and ask the events whether they are there."""
        if asked != "estimate" and (asked != "auto" or world.ring.shape_is_known):
            return None
        look = world.look(fitted)
        plain, shadowed = world.trace(False, TRIAL_RAYS, fitted), world.trace(True, 1, fitted, SURE)
        if asked == "estimate":
            return Decision(self.name, True, ASKED[asked], mean_error(look, plain, shadowed))
        decision = _decision(world, look, plain, shadowed, "the estimated depth")
        if not decision.modelled or events_agree(fitted, look, plain, shadowed):
            return decision
        why = (
            f"not modelled: {decision.found['blocked']:.2%} of the (pixel, LED) pairs that face each other are "
            "blocked on the estimated depth, but events say they are not"
        )
        return replace(decision, modelled=False, why=why)

    def model(self, world: World, decision: Decision) -> World:
        """Trace them on the surface of the fit, whenever it changes."""
        return replace(world, shadows="estimate")


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


def events_agree(fitted: Fitted, look: Look, plain: Illumination, shadowed: Illumination) -> bool:
    """Tell whether some pixels' events are likelier if LEDs are shadowed there than if they are not.

    Shadows on an estimated shape may come of its errors, as highlights bend normals.
    """
    differs = np.abs(look.signals(plain) - look.signals(shadowed)).max(axis=1) > 0
    row = np.searchsorted(fitted.problem.pixel, look.pixel[differs])
    row = row[np.diff(fitted.problem.pairs.offset.numpy().astype(np.int64))[row] > 0]
    if len(row) == 0:
        return True
    row = np.sort(np.random.default_rng(0).permutation(row)[:N_TRIED])
    UInt32 = type(fitted.problem.pairs.offset)
    pixel = owned(UInt32, fitted.problem.pixel[row])
    light = plain.gather(pixel).beside(shadowed.gather(pixel), len(row))
    light = replace(light, constant_light=fitted.problem.illumination.constant_light)
    few = fitted.problem.pairs.of_pixels(row)
    thresholds = fitted.solution.threshold_gain is not None
    cost = trial.costs([few, few], light, np.arange(2 * len(row)).reshape(2, -1), thresholds).sum(axis=1)
    return bool(cost[1] < cost[0])
