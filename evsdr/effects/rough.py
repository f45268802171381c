"""Matt surfaces that are brighter or darker than Lambert's where light or view graze: rough ones, cloth, sheen, bases of coatings.

Some pixels are solved anew with matt parts from smooth to rough; events that are held back say whether any explains more than
Lambert's does.
"""

from dataclasses import dataclass, replace

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.sample import Sample, gained
from evsdr.effects.world import Fitted, World
from evsdr.light.camera import view_directions
from evsdr.metrics import angular_error_deg
from evsdr.model.arrays import owned
from evsdr.solve.noise import IGNORED
from evsdr.solve.problem import Problem
from evsdr.solve.solution import Solution
from evsdr.solve.unknowns import to_normal

NAME = "matt part"
ROUGHNESSES = (0.0, 0.15, 0.4, 0.6, 0.8, 1.0)  # that are tried
RANGE, SETTLED = (0.0, 2.0), 0.03  # of the search from there: bounds, and a step that ends it
LAMBERTIAN = 0.3  # about
N_SAMPLE, FEWEST = 400, 50  # pixels that stand for all, and that can tell
# Standard deviations that it must gain where there are no lobes; measured: matt spheres, blobs, reliefs and sculptures reach 1.6, a
# sphere of roughness 1 10. Beside lobes it is found anyway, as what is below them is seldom Lambert's
LEAST_Z = 5.0


@dataclass(frozen=True)
class RoughEvidence:
    """What events say of the matt part.

    Attributes
    ----------
    roughness : float
        That explains them best.
    z : float
        What it gains over Lambert's, see `sample.gained`.
    error_deg : float
        Expected mean error of the normals with Lambert's [deg].
    is_clear : bool
        Whether it is not Lambert's.
    """

    roughness: float = LAMBERTIAN
    z: float = 0.0
    error_deg: float = 0.0
    is_clear: bool = False


def rough_evidence(problem: Problem, solution: Solution) -> RoughEvidence:
    """Ask the events for the roughness of the matt part, with the lobes of a problem."""
    from scipy.optimize import minimize_scalar  # late: few scenes have one

    good = (problem.pairs.counts > solution.all_theta.shape[1]) & (solution.noise_factor < IGNORED)
    pixel = np.flatnonzero(good)
    pixel = pixel[:: max(1, -(-len(pixel) // N_SAMPLE))]
    if len(pixel) < FEWEST:
        return RoughEvidence()
    sample = Sample.of(problem, pixel, solution.noise, solution.threshold_prior)
    Float, index = type(problem.pairs.phases), owned(type(problem.pairs.first), pixel)

    def model(roughness):
        rough = None if roughness is None else owned(Float, np.array([roughness]))
        return replace(problem, rough=rough).model_at(index)

    _, matt_held, matt = sample.hold_back(solution.all_theta[pixel], model(None))
    tried = [sample.hold_back(matt, model(r)) for r in ROUGHNESSES]
    best = int(
        np.argmin(
            [np.sum(np.minimum(cost - np.min([c for c, *_ in tried], axis=0), 3)) for cost, *_ in tried]
        )
    )
    z, _ = gained(matt_held, tried[best][1])
    error = float(angular_error_deg(to_normal(matt), to_normal(tried[best][2])).mean())
    if z < LEAST_Z and problem.lobe is None:
        return RoughEvidence(ROUGHNESSES[best], z, error)
    theta = tried[best][2]
    found = minimize_scalar(
        lambda r: np.sum(sample.solve(theta, model(r))[0]),
        bounds=RANGE,
        method="bounded",
        options={"xatol": SETTLED},
    )
    error = angular_error_deg(to_normal(matt), to_normal(sample.solve(theta, model(found.x))[1])).mean()
    return RoughEvidence(float(found.x), z, float(error), True)


class RoughMatt:
    """A matt part that is not Lambert's."""

    name, option, when = NAME, "gloss", "settled"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Look for it once it is known whether there are lobes."""
        if "gloss" not in world.decisions:
            return None
        if (
            asked != "auto"
            or world.metal is not None
            or world.terms.solver == "adam"
            or not (world.terms.thorough or world.gloss)
        ):
            return Decision(NAME, False, "Lambert's: not looked for")
        view = view_directions(world.ring, fitted.problem.pixel)
        found = rough_evidence(replace(fitted.problem, view=view), fitted.solution)
        numbers = {"roughness": found.roughness, "z": found.z}
        shown = f"another gains {max(found.z, 0):.1f} standard deviations, {found.error_deg:.2g} deg of expected error"
        if not found.is_clear or found.error_deg < world.terms.limit_deg:
            return Decision(NAME, False, f"Lambert's: {shown}", found.error_deg, numbers)
        brighter = found.roughness > LAMBERTIAN
        why = f"as rough as {found.roughness:.2g}, Lambert's being {LAMBERTIAN}: {shown}"
        warning = (
            f"the surface is {'brighter' if brighter else 'darker'} than a matt one where light or view graze, as "
            f"{'rough surfaces, cloth and sheen' if brighter else 'smooth ones'} are, and was fitted so: errors may be larger than "
            "sigmas say there."
        )
        warning = (
            "" if fitted.problem.lobe is not None else warning
        )  # bases of coatings are as often so as not
        return Decision(NAME, True, why, found.error_deg, numbers, found.roughness, warning)

    def model(self, world: World, decision: Decision) -> World:
        """Put it in the forward model."""
        return replace(world, rough=decision.answer)
