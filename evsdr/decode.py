"""From a problem to maps: the solvers with their settings, and what their solutions look like as images."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import mitsuba as mi
import numpy as np
from scipy import ndimage

from evsdr import adam, lm
from evsdr.problem import Problem
from evsdr.records import Maps
from evsdr.scene import RingScene, camera_geometry, surface_maps
from evsdr.shading import LambertianRing

KNOWN_SIGMA_DEG = 30.0  # a normal known worse than this is not known
MODEL_NORMAL_DEG, MODEL_REFLECTANCE = 0.05, 0.01  # what the model leaves out: degrees, share of reflectance
# the same, times the squared turn of the normal over a pixel [rad]
CURVED_NORMAL, CURVED_REFLECTANCE = 0.2, 0.5
DOWNWEIGHT_ROBUST = 1.0  # width of the Cauchy cost under --shadows downweight
# What changes in the preset's effort, by what a solve is for
PURPOSES = {
    "whole": {},
    "alone": {"priors": None},  # each pixel alone, before its events are put right
    "learn": {"stages": (), "n_sweep": 0, "n_final": 0, "n_expectation": 0},  # go on from there
    "again": {"stages": (), "n_sweep": 0, "n_final": 4, "n_expectation": 4},  # events have changed a little
    "light": {"stages": ()},  # light has changed
    "quick": {
        "stages": (),
        "n_sweep": 1,
        "n_try": 2,
        "n_final": 4,
        "n_expectation": 1,
        "fine": False,
        "priors": None,
    },  # as well as is needed to see where light goes
}


@dataclass(frozen=True)
class Fitted:
    """One fit: the problem, its solution, and the maps it gives."""

    problem: Problem
    solution: lm.Solution
    maps: Maps


@dataclass(frozen=True)
class Decoder:
    """Solves one problem after another with the same settings.

    Attributes
    ----------
    ring : RingScene
    options : fit.Options
        `solver`, `preset`, `shadows` and `seed` count.
    priors : tuple of str
        Of `priors.PARTS`: what pixels tell of each other.
    start_normal : (height, width, 3) float32
        Start values, camera frame.
    thresholds : bool
        Whether each pixel's contrast thresholds are unknown, too.
    """

    ring: RingScene
    options: object
    priors: tuple
    start_normal: np.ndarray
    thresholds: bool

    def __call__(
        self,
        problem: Problem,
        before: Fitted | None = None,
        purpose: str = "whole",
        progress: Callable[[str, float], None] = lambda stage, share: None,
    ) -> Fitted:
        """Solve a problem, from an earlier fit if there is one; arguments as those of `solve`."""
        solution = solve(
            problem,
            self.start_normal,
            self.options,
            self.priors,
            self.thresholds,
            progress,
            before,
            purpose,
        )
        return self.fitted(problem, solution)

    def fitted(self, problem: Problem, solution: lm.Solution) -> Fitted:
        """Lay a solution out as maps."""
        return Fitted(
            problem, solution, assemble_maps(problem, solution, self.start_normal.shape[:2], self.ring)
        )


def start_normals(ring: RingScene, init: str) -> np.ndarray:
    """Give the start values of the normals (height, width, 3): frontal, or those of the geometry."""
    if init == "geometry":
        return surface_maps(ring, 1).normal
    return np.broadcast_to(np.array([0, 0, 1], np.float32), (ring.height, ring.width, 3))


def solve(
    problem: Problem,
    start_normal: np.ndarray,
    options,
    priors: tuple[str, ...],
    estimate_thresholds: bool = False,
    progress: Callable[[str, float], None] = lambda stage, share: None,
    before: Fitted | None = None,
    purpose: str = "whole",
) -> lm.Solution:
    """Run the solver that the options name.

    Parameters
    ----------
    start_normal : (height, width, 3) float32
        Start values, camera frame.
    options : fit.Options
        `solver`, `preset`, `shadows` and `seed` count.
    priors : tuple of str
        Of `priors.PARTS`: what pixels tell of each other.
    estimate_thresholds : bool
        Whether each pixel's contrast thresholds are unknown, too.
    before : Fitted, optional
        An earlier fit of these pixels, to start from instead.
    purpose : str
        Of `PURPOSES`: how much of the preset's effort is needed.
    """
    light = problem.illumination
    effort = replace(choose_effort(options, priors), **PURPOSES[purpose])
    n_step = 0
    log_gain = np.zeros((problem.n_pixel, 2), np.float32)
    if before is None:
        normal = start_normal.reshape(-1, 3)[problem.pixel]
        reflectance = np.full((problem.n_pixel, light.n_band), lm.REFLECTANCE_CENTRE, np.float32)
    else:
        maps, solution = before.maps, before.solution
        start_normal = maps.normal
        normal = maps.normal.reshape(-1, 3)[problem.pixel]
        reflectance = maps.reflectance.reshape(-1, light.n_band)[problem.pixel]
        if estimate_thresholds:
            log_gain = np.log(solution.threshold_gain)
    unknown_gain = [mi.Float(np.ascontiguousarray(g, np.float32)) for g in log_gain.T]
    if options.solver == "adam":
        settings = adam.AdamSettings()
        normal, reflectance = adam.solve(
            light,
            problem.pairs,
            normal,
            problem.pixel,
            start_normal.shape[:2],
            settings,
            options.seed,
            progress,
        )
        n_step = settings.n_step
        effort = replace(
            effort, stages=(), n_sweep=0, n_final=0, priors=None
        )  # only noise and sigma at Adam's result
    solution = lm.solve(
        LambertianRing(light),
        problem.pairs,
        light.constant_light,
        to_theta(normal, reflectance) + (unknown_gain if estimate_thresholds else []),
        problem.grid,
        effort,
        progress,
        before.solution.threshold_prior if before else None,
    )
    return replace(solution, n_step=n_step or solution.n_step)


def choose_effort(options, priors: tuple[str, ...]) -> lm.Effort:
    """Give the effort of a preset with some priors, and with the weights that `--shadows` asks for."""
    effort = lm.PRESETS[options.preset]
    effort = replace(effort, priors=replace(effort.priors, parts=priors) if priors else None)
    return replace(effort, robust=DOWNWEIGHT_ROBUST) if options.shadows == "downweight" else effort


def view_directions(ring: RingScene, pixel: np.ndarray) -> mi.Vector3f | None:
    """Give unit vectors from the surface to a perspective camera, camera frame; None if it is orthographic."""
    geometry, _ = camera_geometry(ring.sensor)
    if not geometry.perspective:
        return None
    points = geometry.points(np.ones((ring.height, ring.width))).reshape(-1, 3)[pixel]
    return mi.Vector3f(*(-points / np.linalg.norm(points, axis=1, keepdims=True)).T.astype(np.float32))


def to_theta(normal: np.ndarray, reflectance: np.ndarray) -> list[mi.Float]:
    """Give slopes and log reflectances as Dr.Jit arrays."""
    nz = np.maximum(normal[:, 2], 1 / lm.LARGEST_SLOPE)
    columns = [-normal[:, 0] / nz, -normal[:, 1] / nz]
    columns += list(np.log(np.maximum(reflectance, np.exp(lm.LOG_REFLECTANCE_RANGE[0]))).T)
    return [mi.Float(np.ascontiguousarray(c, np.float32)) for c in columns]


def assemble_maps(problem: Problem, solution: lm.Solution, shape: tuple[int, int], ring: RingScene) -> Maps:
    """Lay the solution out as images.

    A pixel without information keeps the values of the nearest one that has it, and says so in mask and
    sigma; a band that is never lit says so in sigma. With no constant light the scale of each pixel is unknown; its
    largest band is then 1.
    """
    theta = solution.theta.astype(float)
    normal = np.column_stack([-theta[:, 0], -theta[:, 1], np.ones(len(theta))])
    height = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= height
    reflectance = np.exp(theta[:, 2:])
    sigma = normal_sigma_deg(theta[:, 0], theta[:, 1], solution.covariance[:, :2, :2])
    variance = np.diagonal(solution.covariance, axis1=1, axis2=2)
    turn = normal_turn(normal, problem.grid.mask)
    sigma = np.sqrt(sigma**2 + MODEL_NORMAL_DEG**2 + np.degrees(CURVED_NORMAL * turn**2) ** 2)
    relative = variance[:, 2:] + (MODEL_REFLECTANCE**2 + (CURVED_REFLECTANCE * turn**2) ** 2)[:, None]
    reflectance_sigma = reflectance * np.sqrt(np.maximum(relative, 0))
    if ring.constant_light == 0:
        scale = 1 / reflectance.max(axis=1, keepdims=True)
        reflectance, reflectance_sigma = reflectance * scale, reflectance_sigma * scale
    led = problem.pairs.slot_leds.numpy() & 0xFFFF
    reflectance_sigma[:, ~lit_bands(led, problem.illumination.band)] = 1
    sound = (variance > 0).all(axis=1)  # rounding can spoil an inverse
    known = problem.fired & sound & (sigma < KNOWN_SIGMA_DEG)

    def image(values, elsewhere):
        out = np.full((shape[0] * shape[1], *values.shape[1:]), elsewhere, np.float32)
        out[problem.pixel] = values
        return out.reshape(*shape, *values.shape[1:])

    mask = image(known, 0) > 0
    solved = image(np.ones(len(known)), 0) > 0
    maps = Maps(
        normal=image(normal, 0),
        reflectance=image(reflectance, 0),
        mask=mask,
        normal_sigma_deg=image(np.where(known, sigma, 180), 180),
        reflectance_sigma=image(np.where(known[:, None], np.minimum(reflectance_sigma, 1), 1), 1),
        band_wavelength_nm=ring.leds.band_wavelength_nm.astype(np.float32),
    )
    nearest = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    fill = solved & ~mask if mask.any() else np.zeros_like(mask)
    maps.normal[fill] = maps.normal[tuple(nearest[:, fill])]
    maps.reflectance[fill] = maps.reflectance[tuple(nearest[:, fill])]
    maps.normal[~solved] = (0, 0, 1)
    return maps


def lit_bands(order: np.ndarray, band: list[int]) -> np.ndarray:
    """Tell which bands (n_band,) the LEDs of some slots have; numbers of no LED mean darkness."""
    order = np.asarray(order).astype(np.int64)
    lit = np.asarray(band)[order[(order >= 0) & (order < len(band))]]
    return np.isin(np.arange(max(band) + 1), lit)


def normal_turn(normal: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Give the angle by which the normal turns over each pixel (n_pixel) [rad], from its neighbours (n_pixel, 3)."""
    image = np.full((*mask.shape, 3), np.nan)
    image[mask] = normal
    square = np.zeros(mask.shape)
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(image, axis=axis), axis=-1)
        sides = [np.insert(step, place, np.nan, axis=axis) for place in (0, step.shape[axis])]
        both = np.stack(sides)
        known = np.isfinite(both).sum(axis=0)
        square += (np.nansum(both, axis=0) / np.maximum(known, 1)) ** 2
    return np.sqrt(square[mask])


def normal_sigma_deg(p: np.ndarray, q: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Turn the covariance (n, 2, 2) of slopes into the standard deviation of the normal's angle [deg].

    The root of the trace of the normal's covariance: the root mean square angle.
    """
    h2 = 1 + p**2 + q**2
    # |dn|^2 of a change of slopes is the metric of the sphere in these coordinates
    metric = np.stack([[1 + q**2, -p * q], [-p * q, 1 + p**2]]) / h2**2
    variance = np.einsum("ijn,nij->n", metric, covariance)
    return np.degrees(np.sqrt(np.maximum(variance, 0)))
