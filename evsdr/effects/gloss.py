"""What a fit does about gloss: nothing where the events show none, else a lobe or the paper's angular gate."""

from collections.abc import Callable
from dataclasses import replace

import drjit as dr
import numpy as np

from evsdr.effects.gloss_fit import fit_gloss, gloss_evidence, sort_materials
from evsdr.model.gloss import BlinnPhong, GlossyRing, RoughCoating
from evsdr.model.lambert import LambertianRing
from evsdr.solve import levenberg
from evsdr.solve.problem import Problem
from evsdr.solve.published import gate_weights, pair_weights

KINDS = {
    "lobe": (RoughCoating, "rough dielectric coating, {}", "alpha"),
    "blinn-phong": (BlinnPhong, "Blinn-Phong lobe, {}", "shininess"),
}
N_ROUND = 2  # of lobe, or gate, and maps
AGAIN = ((0.01, None, 4),)  # the solver's descent from a solution


def solve_gloss(
    asked: str,
    problem: Problem,
    matt: levenberg.Solution,
    effort: levenberg.Effort,
    view=None,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> tuple[levenberg.Solution, str]:
    """Improve the solution of the matt model where the surface is glossy.

    Parameters
    ----------
    asked : str
        `auto`, `off`, `lobe`, `blinn-phong` or `gate`.
    problem : Problem
        The pixels.
    matt : levenberg.Solution
        What the matt model finds.
    effort : levenberg.Effort
        How hard to try.
    view : Array3f, optional
        Unit vectors from surface to camera, camera frame; None is the axis of an orthographic camera.

    Returns
    -------
    solution : levenberg.Solution
    note : str
        What was decided and why.
    """
    if asked == "off":
        return matt, "not modelled: asked for by --gloss off; robust weights only"
    known = _with_found_thresholds(problem, matt)
    if asked == "gate":
        solution = matt
        for _ in range(N_ROUND):
            weights = gate_weights(problem.illumination, _normals(problem, solution.theta), view)
            gated = replace(problem.pairs, weight=pair_weights(problem.pairs, weights))
            solution = _again(replace(problem, pairs=gated), effort, solution, None, progress)
        return solution, "angular gate of EventSpecPS: asked for by --gloss gate"
    kind, words, shape = KINDS["lobe" if asked == "auto" else asked]
    evidence = gloss_evidence(known, matt.theta, matt.noise, kind, view)
    if asked == "auto" and not evidence.is_worth_modelling():
        shown = (
            f"{max(evidence.z, 0):.1f} standard deviations, {evidence.error_deg:.2f} deg of expected error"
        )
        return matt, f"not modelled: the residuals show {shown}; robust weights only"
    solution, label, known = matt, None, problem  # thresholds of a matt fit have taken gloss for their own
    for _ in range(N_ROUND):
        gloss = fit_gloss(known, solution.theta, solution.noise, kind, label, view)
        model = GlossyRing(problem.illumination, gloss.lobe(type(problem.pairs.phases)), view)
        solution = _again(problem, effort, solution, model, progress)
        known = _with_found_thresholds(problem, solution)
        label = sort_materials(np.exp(solution.theta[:, 2:]))
    lobes = ", ".join(
        f"{shape} {value:.2g} strength {strength:.2g}" for value, strength in zip(gloss.shape, gloss.strength)
    )
    why = (
        f"left out it would cost {evidence.error_deg:.2g} deg"
        if asked == "auto"
        else f"asked for by --gloss {asked}"
    )
    return solution, f"{words.format(lobes)}: {why}"


def _with_found_thresholds(problem: Problem, solution: levenberg.Solution) -> Problem:
    if solution.threshold_gain is None:
        return problem
    pairs, Float = problem.pairs, type(problem.pairs.phases)
    gains = [Float(np.ascontiguousarray(g, np.float32)) for g in solution.threshold_gain.T]
    on, off = pairs.threshold_on * gains[0], pairs.threshold_off * gains[1]
    dr.eval(on, off)
    return replace(problem, pairs=replace(pairs, threshold_on=on, threshold_off=off))


def _normals(problem: Problem, theta: np.ndarray):
    Array3f, Float = type(problem.illumination.direction[0]), type(problem.pairs.phases)
    p, q = (Float(np.ascontiguousarray(column, np.float32)) for column in theta[:, :2].T)
    return dr.normalize(Array3f(-p, -q, 1))


def _again(
    problem: Problem, effort: levenberg.Effort, solution: levenberg.Solution, model, progress
) -> levenberg.Solution:
    """Solve on from a solution, with thresholds unknown if they were."""
    Float, light = type(problem.pairs.phases), problem.illumination
    columns = list(solution.theta.T)
    if solution.threshold_gain is not None:
        columns += list(np.log(solution.threshold_gain).T)
    start = [Float(np.ascontiguousarray(column, np.float32)) for column in columns]
    effort = replace(effort, stages=AGAIN)
    model = model or LambertianRing(light)
    given = problem.pairs, light.constant_light, start, problem.grid, effort, progress
    again = levenberg.solve(model, *given, solution.threshold_prior)
    return replace(again, n_step=solution.n_step + again.n_step)
