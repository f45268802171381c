"""A glossy sphere: what gloss costs, and what robust weights, the angular gate and a modelled lobe save."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from evsdr.effects.gloss_fit import Evidence, Gloss, fit_gloss, gloss_evidence, sort_materials
from evsdr.events.pairs import pair_events
from evsdr.events.pixel import EventPixel
from evsdr.events.record import record, ring_schedule
from evsdr.fitting.maps import assemble_maps
from evsdr.light import ground_truth, scene, tracing
from evsdr.metrics import score
from evsdr.model.gloss import BlinnPhong, GlossyRing, RoughCoating
from evsdr.model.lambert import LambertianRing
from evsdr.records import Truth
from evsdr.solve import levenberg
from evsdr.solve.problem import Problem, make_problem
from evsdr.solve.published import gate_weights, pair_weights
from evsdr.solve.unknowns import to_theta

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
    truth = ground_truth.surface_maps(ring, 16)
    signal = tracing.led_images(ring, 16)
    light, coverage = tracing.trace_illumination(ring, 16, False)
    lobe = RoughCoating(mi.Float(ROUGHNESS**2), mi.Float(0.0 if name == "matt" else 1.0))
    if name == "blinn-phong":
        normal = mi.Vector3f(truth.normal.reshape(-1, 3).T)
        lobe = BlinnPhong(mi.Float(SHININESS), mi.Float(STRENGTH))
        for j, (direction, irradiance) in enumerate(zip(light.direction, light.irradiance)):
            value = (irradiance * lobe(normal, direction, mi.Vector3f(0, 0, 1))[0]).numpy()
            signal[j] += coverage * value.reshape(coverage.shape)
    pixel = EventPixel(event_noise=0.1).idealised()
    recording = record(signal, ring.constant_light, pixel, ring_schedule(len(signal)), 6, seed)
    mask = coverage >= 0.5
    problem = make_problem(recording, pair_events(recording, mask), light, mask)
    return Sphere(ring, problem, Truth(truth.normal, truth.reflectance, truth.mask), lobe)


def solve(
    problem: Problem, effort: levenberg.Effort, model=None, start: np.ndarray | None = None
) -> levenberg.Solution:
    """Fit with a model, by default the matt one, from frontal normals or from slopes and log reflectances."""
    light = problem.illumination
    if start is None:
        normal = np.tile([0.0, 0.0, 1.0], (problem.n_pixel, 1))
        theta = to_theta(
            normal, np.full((problem.n_pixel, light.n_band), levenberg.REFLECTANCE_CENTRE), mi.Float
        )
    else:
        theta = [mi.Float(np.ascontiguousarray(column, np.float32)) for column in start.T]
        effort = replace(effort, stages=AGAIN)
    model = model or LambertianRing(light)
    return levenberg.solve(model, problem.pairs, light.constant_light, theta, problem.grid, effort)


# ---------------------------------------------------------------------- methods


def matt(sphere: Sphere, effort: levenberg.Effort) -> tuple[levenberg.Solution, str]:
    """Fit the matt model."""
    return solve(sphere.problem, effort), ""


def gated(sphere: Sphere, effort: levenberg.Effort) -> tuple[levenberg.Solution, str]:
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


def modelled(sphere: Sphere, effort: levenberg.Effort) -> tuple[levenberg.Solution, str]:
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


def lobe_known(sphere: Sphere, effort: levenberg.Effort) -> tuple[levenberg.Solution, str]:
    """Fit the matt model, then with the true lobe: as far as an estimated one can reach."""
    start = solve(sphere.problem, effort).theta
    return solve(sphere.problem, effort, GlossyRing(sphere.problem.illumination, sphere.lobe), start), ""


def describe(evidence: Evidence) -> str:
    """Put evidence in words."""
    return f"z {evidence.z:.1f}, expected error {evidence.error_deg:.2f} deg"


def describe_gloss(gloss: Gloss) -> str:
    """Name shape and strength of each kind of material."""
    return ", ".join(f"shape {a:.3g} strength {k:.3g}" for a, k in zip(gloss.shape, gloss.strength))


BALANCED = levenberg.PRESETS["balanced"]
METHODS: dict[str, tuple[Callable, levenberg.Effort]] = {
    "least squares": (matt, replace(BALANCED, robust=LEAST_SQUARES)),
    "robust, width 2 (default)": (matt, BALANCED),
    "robust, width 1": (matt, replace(BALANCED, robust=1.0)),
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
    maps = assemble_maps(sphere.problem, solution, sphere.truth.mask.shape, sphere.ring)
    return Result(method, score(maps, sphere.truth), time.process_time() - begin, note)
