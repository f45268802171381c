"""Gloss: left out where the events show none, else a lobe fitted with the maps."""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.gloss_fit import LEAST_Z, N_SAMPLE, GlossEvidence, fit_gloss, gloss_evidence
from evsdr.effects.materials import sort_materials
from evsdr.effects.payment import wider
from evsdr.effects.shared import in_doubt
from evsdr.effects.world import Fitted, World
from evsdr.light.camera import view_directions
from evsdr.model.arrays import columns
from evsdr.model.gloss import BlinnPhong, RoughCoating
from evsdr.records import Maps
from evsdr.solve.loss import scaled
from evsdr.solve.problem import Problem
from evsdr.solve.solution import Solution

NAME = "gloss"
# Of what gloss does to a matt fit: lobes of materials are not quite of the form that is fitted. Measured on a sphere of another
# diffuse base (scenes/glossy_sphere.xml) and on blobs of another lobe (experiments.table1)
LOBE_ERROR = 0.15
N_FEW = 120  # pixels that the preset fast asks for gloss; measured: see experiments/gloss
# Standard deviations from which gloss is not clear, but may be there, and more pixels are asked; guessed. Measured on 25 matt draws of
# `experiments.draws` (0 to 27): 0.4 at most, but 1.2 on a white figure whose parts light each other
MAYBE_Z, MORE = 1.0, (N_SAMPLE, 4 * N_SAMPLE)
KINDS = {
    "lobe": (RoughCoating, "rough dielectric coating, {}", "alpha"),
    "blinn-phong": (BlinnPhong, "Blinn-Phong lobe, {}", "shininess"),
}


def find_gloss(
    asked: str,
    problem: Problem,
    solution: Solution,
    limit_deg: float,
    before: Decision | None = None,
    most: int = N_SAMPLE,
) -> Decision:
    """Ask the residuals of a fit for lobes.

    Parameters
    ----------
    asked : str
        `auto`, `lobe` or `blinn-phong`.
    problem : Problem
        The pixels, with their view.
    solution : Solution
        What fits them.
    limit_deg : float
        Mean error of the normals from which gloss is modelled [deg].
    before : Decision, optional
        By which lobes are in that fit already: these are refined, by the kinds of material that it tells.
    most : int
        Pixels, at most, that are asked first whether there are any.
    """
    kind, words, shape = KINDS["lobe" if asked == "auto" else asked]
    if before:
        error, label = before.expected_deg, sort_materials(np.exp(solution.theta[:, 2:]))
    else:
        matt = solution.all_theta, solution.noise, kind, solution.threshold_prior
        evidence, label = seek(problem, matt, limit_deg, most), None
        error = evidence.error_deg
        if asked == "auto" and not evidence.is_worth_modelling(limit_deg):
            shown = f"{max(evidence.z, 0):.1f} standard deviations, {error:.2f} deg of expected error"
            why = f"not modelled: the residuals show {shown}; robust weights only"
            return Decision(NAME, False, why, error, {"z": evidence.z})
    known = _with_found_thresholds(problem, solution) if before else problem
    free = solution.threshold_gain is not None
    theta, spread = (solution.theta, None) if before else (solution.all_theta, solution.threshold_prior)
    gloss = fit_gloss(known, theta, solution.noise, kind, label, spread, free)
    if asked == "auto" and not gloss.strength.any():
        why = f"not modelled: where lobes that {'were found' if before else 'may be there'} show most, the events have none"
        return Decision(NAME, False, why, error, taken_back=before is not None)
    if before and free:
        gloss = replace(gloss, log_threshold=gloss.log_threshold + np.array(solution.threshold_prior[:2]))
    lobes = ", ".join(f"{shape} {a:.2g} strength {s:.2g}" for a, s in zip(gloss.shape, gloss.strength) if s)
    share = np.mean(gloss.strength[gloss.label] > 0)
    lobes = lobes or "of no strength" if share in (0, 1) else f"{lobes}, on {share:.0%} of the pixels"
    why = f"left out it would cost {error:.2g} deg" if asked == "auto" else f"asked for by --gloss {asked}"
    found = {shape: gloss.shape.tolist(), "strength": gloss.strength.tolist(), "share": float(share)}
    return Decision(NAME, True, f"{words.format(lobes)}: {why}", error, found, gloss)


def seek(problem: Problem, matt: tuple, limit_deg: float, most: int) -> GlossEvidence:
    """Ask `most` pixels for gloss, and more of them as long as it may be there but is not clear; `matt` is the fit."""
    evidence, fired = gloss_evidence(problem, *matt, most), np.count_nonzero(problem.pairs.counts > 0)
    for more in MORE:
        if not MAYBE_Z < evidence.z <= LEAST_Z or evidence.error_deg < limit_deg:
            break
        if most < min(more, fired):
            evidence, most = gloss_evidence(problem, *matt, more), more
    return evidence


def _with_found_thresholds(problem: Problem, solution: Solution) -> Problem:
    """Take the thresholds of a glossy fit for known; those of a matt one have taken gloss for their own."""
    if solution.threshold_gain is None:
        return problem
    pairs = scaled(problem.pairs, columns(type(problem.pairs.phases), solution.threshold_gain))
    dr.eval(pairs.threshold_on, pairs.threshold_off)
    return replace(problem, pairs=pairs)


def lobe_error(change: np.ndarray) -> np.ndarray:
    """Give the covariances (n_pixel, n, n) that lobes of another form leave, from how gloss changed the unknowns (n_pixel, n)."""
    return LOBE_ERROR**2 * change[:, :, None] * change[:, None, :]


class GlossyLobes:
    """Lobes, one for each kind of material."""

    name, option, when = NAME, "gloss", "settled"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Look for gloss in the residuals of the matt fit; refine it in those of the glossy one."""
        before = world.decisions.get(self.name)
        if before and not before.modelled:
            return None
        if world.metal is not None:
            return Decision(self.name, False, "not looked for on metal")
        if world.terms.solver == "adam":
            return Decision(self.name, False, "angular gate, as published")
        if asked == "off":
            return Decision(self.name, False, "not modelled: asked for by --gloss off; robust weights only")
        problem = replace(fitted.problem, view=view_directions(world.ring, fitted.problem.pixel))
        most = N_SAMPLE if world.terms.thorough else N_FEW
        return find_gloss(asked, problem, fitted.solution, world.terms.limit_deg, before, most)

    def model(self, world: World, decision: Decision) -> World:
        """Put the lobes in the forward model."""
        return replace(world, gloss=decision.answer)


@dataclass(frozen=True)
class Unseen:
    """What lobes that nothing was told of make of maps: by how much normals turn [deg], and log reflectances (n_band,) change."""

    turn_deg: float
    log_reflectance: np.ndarray

    def pay(self, maps: Maps) -> Maps:
        """Add it to the sigmas."""
        return wider(maps, self.turn_deg, self.log_reflectance)


class GlossOrPowers:
    """Gloss that LED powers passed for: on a surface that looks one way each explains what the other does."""

    name, option, when = NAME, "gloss", "last"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Look for gloss as if powers were as told, where they were found but are hardly better known."""
        before = world.decisions.get(self.name)
        if asked != "auto" or before is None or before.modelled or world.aim is None:
            return None
        if world.metal is not None or not in_doubt(world.decisions, "powers"):
            return None
        as_told = replace(world, aim=replace(world.aim, log_power=np.zeros_like(world.aim.log_power)))
        solution, view = fitted.solution, view_directions(world.ring, fitted.problem.pixel)
        problem = replace(as_told.problem(fitted), view=view)
        matt = solution.all_theta, solution.noise, RoughCoating, solution.threshold_prior
        evidence = gloss_evidence(problem, *matt)
        if not evidence.is_worth_modelling(world.terms.limit_deg):
            return None
        why = (
            f"not modelled, paid for in sigma: LED powers that differ from what is told explain the events; if they are as told, "
            f"the surface has gloss, and normals are {evidence.error_deg:.2g} degrees off"
        )
        answer, found = Unseen(evidence.error_deg, evidence.log_reflectance), {"z": evidence.z}
        return Decision(self.name, False, why, evidence.error_deg, found, answer)

    def model(self, world: World, decision: Decision) -> World:
        """Leave it: no event tells it."""
        return world
