"""The solvers with their settings, run on one problem after another."""

from dataclasses import dataclass, replace

import numpy as np

from evsdr.effects.world import Fitted
from evsdr.fitting.maps import assemble_maps
from evsdr.fitting.misfit import Misfit, explain_misfit
from evsdr.fitting.presets import PRESETS
from evsdr.fitting.settings import Settings
from evsdr.light.ground_truth import surface_maps
from evsdr.light.scene import RingScene
from evsdr.progress import Progress, silent
from evsdr.records import Signals
from evsdr.solve import published, recipes
from evsdr.solve.loop import data_of, resume, start_of
from evsdr.solve.loop import solve as run
from evsdr.solve.measured import measure_signals
from evsdr.solve.pair_data import thin
from evsdr.solve.problem import Problem
from evsdr.solve.solution import STEPS_USED_UP, Data, Solution
from evsdr.solve.stages import softness_at
from evsdr.solve.twins import Twins
from evsdr.solve.unknowns import first_theta, to_theta

DOWNWEIGHT_ROBUST = 1.0  # width of the Cauchy cost under --shadows downweight
PUBLISHED_ROBUST = 3.0  # the same of the published decoder; measured: at 1 it loses all contrast
# Of which signals are measured, and LEDs: of more, pixels in the middle for as much work
MOST_SIGNALS, MOST_LEDS = 4_000_000, 64
# Recipes by what a solve is for
RECIPES = {
    "whole": recipes.whole,
    "rough": recipes.rough,  # before events are put right
    "metal": recipes.rough_metal,  # the same of metal
    "learn": recipes.refine,  # go on from there
    "sketch": recipes.sketch,  # events have changed a little, and may again
    "search": recipes.search,  # as well as is needed to see how photoreceptors lag
    "touch": recipes.touch,  # events have changed a little, else the same
    "again": recipes.after_events,  # events have changed a little
    "light": recipes.after_light,  # light has changed
    "relit": recipes.sketch_after_light,  # light has changed, and events may
    "model": recipes.after_model,  # the surface's model has changed
    "quick": recipes.quick,  # as well as is needed to see where light goes
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
        progress: Progress = silent,
    ) -> Fitted:
        """Solve a problem, from an earlier fit if there is one; arguments as those of `solve`."""
        given = problem, self.start_normal, self.settings
        if self.settings.solver == "adam":
            *values, solution = solve_as_published(*given, progress)
            return self.fitted(problem, solution, tuple(values))
        return self.fitted(problem, solve(*given, self.thresholds, progress, before, purpose))

    def misfit(self, fitted: Fitted) -> Misfit:
        """Say where the events are explained less well than elsewhere, see `misfit.explain_misfit`."""
        return explain_misfit(fitted, choose_effort(self.settings).width(self.thresholds))

    def signals(self, fitted: Fitted) -> Signals:
        """Ask the events what each LED gives each pixel, or some where all are too many."""
        problem, n_led = fitted.problem, fitted.problem.illumination.n_led
        most = int(MOST_SIGNALS / n_led * min(1, (MOST_LEDS / n_led) ** 2))
        return measure_signals(self._data(problem), fitted.solution, problem.pixel, max(most, 1))

    def alone(self, fitted: Fitted) -> np.ndarray:
        """Give the covariances that maps would have if neighbours told nothing."""
        data = self._data(fitted.problem)
        return run(data, recipes.measure(), resume(data, fitted.solution)).covariance

    def twins(self, fitted: Fitted) -> np.ndarray:
        """Give the covariances that not knowing which of two normals of metal is true leaves open."""
        data, solution = self._data(fitted.problem), fitted.solution
        state = replace(resume(data, solution), noise=solution.noise)
        if solution.curved:
            state = replace(state, softness=softness_at(data, state.theta))
        both = Twins(recipes.MOST, choose_effort(self.settings).tolerance).explain(data, state)
        return both.left_open(solution.noise_factor)

    def _data(self, problem: Problem) -> Data:
        width, veil = choose_effort(self.settings).width(self.thresholds), problem.illumination.constant_light
        return data_of(problem.model, problem.pairs, veil, problem.grid, width)

    def fitted(self, problem: Problem, solution: Solution, values: tuple | None = None) -> Fitted:
        """Lay a solution out as maps; `values` are normals and reflectances that stand as they are."""
        shape = self.start_normal.shape[:2]
        return Fitted(problem, solution, assemble_maps(problem, solution, shape, self.ring, values))


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
    progress: Progress = silent,
    before: Fitted | None = None,
    purpose: str = "whole",
) -> Solution:
    """Solve by Levenberg-Marquardt.

    Parameters
    ----------
    start_normal : (height, width, 3) float32
        Start values, camera frame.
    settings : Settings
        `preset`, `priors` and `shadows` count.
    estimate_thresholds : bool
        Whether each pixel's contrast thresholds are unknown, too.
    before : Fitted, optional
        An earlier fit of these pixels, to start from instead.
    purpose : str
        Of `RECIPES`.
    """
    light, effort = problem.illumination, choose_effort(settings)
    Float = type(light.constant_light)
    pairs = thin(problem.pairs, effort.n_most) if effort.n_most else problem.pairs
    width = effort.width(estimate_thresholds)
    data = data_of(problem.model, pairs, light.constant_light, problem.grid, width)
    if before is None:
        theta = first_theta(
            start_normal.reshape(-1, 3)[problem.pixel], light.n_band, estimate_thresholds, Float
        )
        start = start_of(data, theta, effort.n_early)
    else:
        start = resume(data, before.solution, effort.n_early, problem.start)
    solution = run(data, RECIPES[purpose](effort), start, progress)
    if before is None:
        return solution
    history = before.solution.history + solution.history
    return replace(solution, n_step=before.solution.n_step + solution.n_step, history=history)


def solve_as_published(problem: Problem, start_normal: np.ndarray, settings: Settings, progress) -> tuple:
    """Solve by the decoder of the EventSpecPS paper.

    Returns
    -------
    normal : (n_pixel, 3) float32
    reflectance : (n_pixel, n_band) float32
    solution : Solution
        What sigma these have.
    """
    light = problem.illumination
    adam = published.AdamSettings(robust=PUBLISHED_ROBUST if settings.shadows == "downweight" else None)
    normal, reflectance = published.solve(
        light,
        problem.pairs,
        start_normal.reshape(-1, 3)[problem.pixel],
        problem.pixel,
        start_normal.shape[:2],
        adam,
        settings.seed,
        progress,
    )
    width = choose_effort(settings).robust
    data = data_of(problem.model, problem.pairs, light.constant_light, problem.grid, width)
    theta = to_theta(normal, reflectance, type(light.constant_light))
    solution = run(data, recipes.measure(), start_of(data, theta))
    return normal, reflectance, replace(solution, n_step=adam.n_step, result=STEPS_USED_UP)


def choose_effort(settings: Settings) -> recipes.Effort:
    """Give the effort of a preset with some priors, and with the weights that `shadows` asks for."""
    effort, parts = PRESETS[settings.preset].effort, settings.priors
    if settings.tolerance is not None:
        effort = effort.at(settings.tolerance)
    priors = replace(effort.priors, parts=parts) if parts else None
    effort = replace(effort, priors=priors, tuning=settings.tuning)
    return replace(effort, robust=DOWNWEIGHT_ROBUST) if settings.shadows == "downweight" else effort
