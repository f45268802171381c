"""The solvers with their settings, run on one problem after another."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from evsdr.effects.world import Fitted
from evsdr.fitting.maps import assemble_maps
from evsdr.fitting.presets import PRESETS
from evsdr.fitting.settings import Settings
from evsdr.light.ground_truth import surface_maps
from evsdr.light.scene import RingScene
from evsdr.solve import levenberg, published
from evsdr.solve.problem import Problem
from evsdr.solve.unknowns import to_theta

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
    "model": {"stages": ((0.01, None, 4),)},  # the surface's model has changed
}


@dataclass(frozen=True)
class Decoder:
    """Solves one problem after another with the same settings.

    Attributes
    ----------
    ring : RingScene
    settings : Settings
        `solver`, `preset`, `priors`, `shadows` and `seed` count.
    start_normal : (height, width, 3) float32
        Start values, camera frame.
    thresholds : bool
        Whether each pixel's contrast thresholds are unknown, too.
    """

    ring: RingScene
    settings: Settings
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
            self.settings,
            self.thresholds,
            progress,
            before,
            purpose,
        )
        return self.fitted(problem, solution)

    def fitted(self, problem: Problem, solution: levenberg.Solution) -> Fitted:
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
    settings: Settings,
    estimate_thresholds: bool = False,
    progress: Callable[[str, float], None] = lambda stage, share: None,
    before: Fitted | None = None,
    purpose: str = "whole",
) -> levenberg.Solution:
    """Run the solver that the settings name.

    Parameters
    ----------
    start_normal : (height, width, 3) float32
        Start values, camera frame.
    settings : Settings
        `solver`, `preset`, `priors`, `shadows` and `seed` count.
    estimate_thresholds : bool
        Whether each pixel's contrast thresholds are unknown, too.
    before : Fitted, optional
        An earlier fit of these pixels, to start from instead.
    purpose : str
        Of `PURPOSES`: how much of the preset's effort is needed.
    """
    light = problem.illumination
    effort = replace(choose_effort(settings), **PURPOSES[purpose])
    n_step = 0
    log_gain = np.zeros((problem.n_pixel, 2), np.float32)
    if before is None:
        normal = start_normal.reshape(-1, 3)[problem.pixel]
        reflectance = np.full((problem.n_pixel, light.n_band), levenberg.REFLECTANCE_CENTRE, np.float32)
    else:
        maps, solution = before.maps, before.solution
        start_normal = maps.normal
        normal = maps.normal.reshape(-1, 3)[problem.pixel]
        reflectance = maps.reflectance.reshape(-1, light.n_band)[problem.pixel]
        if estimate_thresholds:
            log_gain = np.log(solution.threshold_gain)
    Float = type(problem.pairs.phases)
    unknown_gain = [Float(np.ascontiguousarray(g, np.float32)) for g in log_gain.T]
    if settings.solver == "adam":
        adam = published.AdamSettings()
        normal, reflectance = published.solve(
            light,
            problem.pairs,
            normal,
            problem.pixel,
            start_normal.shape[:2],
            adam,
            settings.seed,
            progress,
        )
        n_step = adam.n_step
        effort = replace(
            effort, stages=(), n_sweep=0, n_final=0, priors=None
        )  # only noise and sigma at Adam's result
    solution = levenberg.solve(
        problem.model,
        problem.pairs,
        light.constant_light,
        to_theta(normal, reflectance, Float) + (unknown_gain if estimate_thresholds else []),
        problem.grid,
        effort,
        progress,
        before.solution.threshold_prior if before else None,
    )
    return replace(solution, n_step=n_step or solution.n_step)


def choose_effort(settings: Settings) -> levenberg.Effort:
    """Give the effort of a preset with some priors, and with the weights that `shadows` asks for."""
    effort, parts = PRESETS[settings.preset].effort, settings.priors
    effort = replace(effort, priors=replace(effort.priors, parts=parts) if parts else None)
    return replace(effort, robust=DOWNWEIGHT_ROBUST) if settings.shadows == "downweight" else effort
