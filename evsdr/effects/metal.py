"""Metal: no matt part, found before anything else is asked of the events."""

from dataclasses import replace

from evsdr.effects.effect import Decision
from evsdr.effects.metal_fit import metal_evidence, refine_roughness
from evsdr.effects.world import Fitted, World
from evsdr.light.camera import view_directions

NAME = "metal"
OF_MATT = "not looked for on metal"


class Metal:
    """A surface of metal in the place of a matt one."""

    name, option, when = NAME, "gloss", "anew"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision:
        """Solve some pixels as either."""
        if asked != "auto":
            return Decision(NAME, False, f"not looked for: asked for by --gloss {asked}")
        if world.terms.solver == "adam":
            return Decision(NAME, False, "not looked for by the solver adam")
        view = view_directions(world.ring, fitted.problem.pixel)
        found = metal_evidence(replace(fitted.problem, view=view), world.thresholds)
        shown = f"metal gains {found.gain:.2f} in log likelihood of a pixel over a matt surface"
        if not found.is_clear:
            return Decision(NAME, False, f"not modelled: {shown}", found={"z": found.z})
        return told(found.roughness, f"{shown}, {found.z:.1f} standard deviations", {"z": found.z})

    def model(self, world: World, decision: Decision) -> World:
        """Put it in the forward model."""
        return replace(world, metal=decision.answer)


class RoughnessOfMetal(Metal):
    """The roughness again, on the pixels that were fitted."""

    when = "settled"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Refine it once."""
        before = world.decisions[NAME]
        if not before.modelled or "refined" in before.found:
            return None
        roughness = refine_roughness(fitted.problem, fitted.solution)
        why = before.why.partition(": ")[2]
        return told(roughness, why, before.found | {"refined": True})


def told(roughness: float, why: str, found: dict) -> Decision:
    """Decide on metal of a roughness."""
    warning = (
        f"the surface looks like metal of roughness {roughness:.2g} and was fitted so: reflectance is that of its mirror facets, "
        "and errors may be larger than sigmas say where it hardly sends light to the camera"
    )
    found = found | {"alpha": roughness}
    return Decision(NAME, True, f"roughness {roughness:.2g}: {why}", None, found, roughness, warning)
