"""A glossy sphere: what gloss costs, and what robust weights, the angular gate and a modelled lobe save."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from evsdr import decode, lm, scene
from evsdr.event_pixel import EventPixel
from evsdr.gloss import (
    BlinnPhong,
    GlossyRing,
    RoughCoating,
    gate_weights,
    pair_residuals,
    pair_weights,
    robust_width,
)
from evsdr.gloss_fit import Evidence, Gloss, fit_gloss, gloss_evidence, sort_materials
from evsdr.metrics import Truth, score
from evsdr.pairs import pair_events
from evsdr.problem import Problem, make_problem
from evsdr.shading import LambertianRing
from evsdr.simulate import Options, record

SCENES = Path(__file__).resolve().parents[2] / "scenes"
LEAST_SQUARES = 50.0  # width of a Cauchy cost that is least squares for all purposes
ROUGHNESS = 0.4  # of glossy_sphere.xml; the facets' alpha is its square
SHININESS, STRENGTH = 32.0, 0.3  # of the Blinn-Phong sphere; the shininess is the paper's
N_ROUND = 2  # of lobe and maps, of gate and maps
AGAIN = ((0.01, None, 4),)  # descent from maps that are nearly right


@dataclass(frozen=True)
class Sphere:
    """A simulated recording, ready to solve.

    Attributes
    ----------
    ring : scene.RingScene
    problem : Problem
    truth : Truth
    lobe : RoughCoating or BlinnPhong
        Its gloss; of strength 0 if matt.
    """

    ring: scene.RingScene
    problem: Problem
    truth: Truth
    lobe: object


@dataclass(frozen=True)
class Result:
    """What one method reached.

    Attributes
    ----------
    method : str
    error : dict
        See `metrics.score`.
    seconds : float
        Of all cores, from event pairs to maps.
    note : str
        What it found of the gloss.
    """

    method: str
    error: dict
    seconds: float
    note: str = ""


def simulate(name: str, size: int, seed: int = 0) -> Sphere:
    """Simulate the sphere `matt`, `coating` or `blinn-phong` with 10 % noise on thresholds.

    Mitsuba has no Blinn-Phong: that lobe is added to the images of the matt sphere.
    """
    file = "glossy_sphere.xml" if name == "coating" else "sphere.xml"
    ring = scene.load_scene(SCENES / file, {"size": str(size)})
    truth = scene.surface_maps(ring, 16)
    signal = scene.led_images(ring, 16)
    light, coverage = scene.trace_illumination(ring, 16, False)
    lobe = RoughCoating(mi.Float(ROUGHNESS**2), mi.Float(0.0 if name == "matt" else 1.0))
    if name == "blinn-phong":
        normal = mi.Vector3f(truth.normal.reshape(-1, 3).T)
        lobe = BlinnPhong(mi.Float(SHININESS), mi.Float(STRENGTH))
        for j, (direction, irradiance) in enumerate(zip(light.direction, light.irradiance)):
            value = (irradiance * lobe(normal, direction, mi.Vector3f(0, 0, 1))[0]).numpy()
            signal[j] += coverage * value.reshape(coverage.shape)
    options = Options(out=Path(), ideal=True, seed=seed, pixel=EventPixel(event_noise=0.1))
    recording = record(signal, ring.constant_light, options)
    mask = coverage >= 0.5
    problem = make_problem(recording, pair_events(recording, mask), light, mask)
    return Sphere(ring, problem, Truth(truth.normal, truth.reflectance, truth.mask), lobe)


def solve(problem: Problem, effort: lm.Effort, model=None, start: np.ndarray | None = None) -> lm.Solution:
    """Fit with a model, by default the matt one, from frontal normals or from slopes and log reflectances."""
    light = problem.illumination
    if start is None:
        normal = np.tile([0.0, 0.0, 1.0], (problem.n_pixel, 1))
        theta = decode.to_theta(normal, np.full((problem.n_pixel, light.n_band), lm.REFLECTANCE_CENTRE))
    else:
        theta = [mi.Float(np.ascontiguousarray(column, np.float32)) for column in start.T]
        effort = replace(effort, stages=AGAIN)
    model = model or LambertianRing(light)
    return lm.solve(model, problem.pairs, light.constant_light, theta, problem.grid, effort)


# ---------------------------------------------------------------------- methods


def matt(sphere: Sphere, effort: lm.Effort) -> tuple[lm.Solution, str]:
    """Fit the matt model."""
    return solve(sphere.problem, effort), ""


def own_width(sphere: Sphere, effort: lm.Effort) -> tuple[lm.Solution, str]:
    """Fit the matt model twice, the second time with the width that the residuals of the first ask for."""
    problem, light = sphere.problem, sphere.problem.illumination
    first = solve(problem, effort)
    width = robust_width(
        pair_residuals(LambertianRing(light), problem.pairs, light.constant_light, first.theta)
    )
    return solve(problem, replace(effort, robust=width), start=first.theta), f"width {width:.2f}"


def gated(sphere: Sphere, effort: lm.Effort) -> tuple[lm.Solution, str]:
    """Fit the matt model with the angular gate at the normals known so far."""
    problem = sphere.problem
    solution = solve(problem, effort)
    for _ in range(N_ROUND):
        p, q = (mi.Float(np.ascontiguousarray(column)) for column in solution.theta[:, :2].T)
        normal = mi.Vector3f(-p, -q, 1.0)
        weight = pair_weights(problem.pairs, gate_weights(problem.illumination, dr.normalize(normal)))
        gated_pairs = replace(problem.pairs, weight=weight)
        solution = solve(replace(problem, pairs=gated_pairs), effort, start=solution.theta)
    return solution, ""


def modelled(sphere: Sphere, effort: lm.Effort) -> tuple[lm.Solution, str]:
    """Fit the matt model; where its residuals show gloss, fit lobes and maps in turn."""
    problem = sphere.problem
    solution = solve(problem, effort)
    evidence = gloss_evidence(problem, solution.theta, solution.noise, type(sphere.lobe))
    if not evidence.is_worth_modelling():
        return solution, f"no gloss: {describe(evidence)}"
    label = None
    for _ in range(N_ROUND):
        gloss = fit_gloss(problem, solution.theta, solution.noise, type(sphere.lobe), label)
        model = GlossyRing(problem.illumination, gloss.lobe(mi.Float))
        solution = solve(problem, effort, model, solution.theta)
        label = sort_materials(np.exp(solution.theta[:, 2:]))
    return solution, f"{describe(evidence)}; {describe_gloss(gloss)}"


def lobe_known(sphere: Sphere, effort: lm.Effort) -> tuple[lm.Solution, str]:
    """Fit the matt model, then with the true lobe: as far as an estimated one can reach."""
    start = solve(sphere.problem, effort).theta
    return solve(sphere.problem, effort, GlossyRing(sphere.problem.illumination, sphere.lobe), start), ""


def describe(evidence: Evidence) -> str:
    """Put evidence in words."""
    return f"z {evidence.z:.1f}, expected error {evidence.error_deg:.2f} deg"


def describe_gloss(gloss: Gloss) -> str:
    """Name shape and strength of each kind of material."""
    return ", ".join(f"shape {a:.3g} strength {k:.3g}" for a, k in zip(gloss.shape, gloss.strength))


BALANCED = lm.PRESETS["balanced"]
METHODS: dict[str, tuple[Callable, lm.Effort]] = {
    "least squares": (matt, replace(BALANCED, robust=LEAST_SQUARES)),
    "robust, width 2 (default)": (matt, BALANCED),
    "robust, width 1": (matt, replace(BALANCED, robust=1.0)),
    "robust, width of residuals": (own_width, BALANCED),
    "angular gate, least squares": (gated, replace(BALANCED, robust=LEAST_SQUARES)),
    "angular gate, robust": (gated, BALANCED),
    "lobe found": (modelled, BALANCED),
    "lobe known": (lobe_known, BALANCED),
}


def run(sphere: Sphere, method: str) -> Result:
    """Apply one method, score it and time it."""
    begin = time.process_time()
    solve_by, effort = METHODS[method]
    solution, note = solve_by(sphere, effort)
    maps = decode.assemble_maps(sphere.problem, solution, sphere.truth.mask.shape, sphere.ring)
    return Result(method, score(maps, sphere.truth), time.process_time() - begin, note)
