"""The loop of a solve: a recipe is a tuple of stages, which run one after another from state to state."""

import time
from dataclasses import replace

import drjit as dr
import numpy as np

from evsdr.frozen import no_garbage_collection
from evsdr.model.arrays import columns
from evsdr.progress import Progress, silent
from evsdr.solve.grid import Grid
from evsdr.solve.levenberg import OPEN_SHARE
from evsdr.solve.pair_data import PairData, room_for, thin
from evsdr.solve.solution import NO_INFORMATION, SETTLED, STEPS_USED_UP, Data, Passed, Solution, State
from evsdr.solve.stages import Stage, mean
from evsdr.solve.threshold_spread import first_spread


@no_garbage_collection()
def solve(data: Data, recipe: tuple[Stage, ...], start: State, progress: Progress = silent) -> Solution:
    """Run the stages of a recipe one after another.

    Parameters
    ----------
    data : Data
        What is given.
    recipe : tuple of Stage
        See `recipes`; the last ones must be `PixelNoise` and `Neighbours`.
    start : State
        See `start_of` and `resume`.
    progress : callable (stage, share) -> bool, optional
        Told what is done, share 0..1; once it gives True, each stage that is left makes hardly a step.

    Returns
    -------
    Solution
    """
    state, history = start, []
    for stage in recipe:
        begin, steps = time.perf_counter(), state.n_step
        state = stage(data, replace(state, open=0.0), progress)
        dr.eval(state.theta, state.terms)
        cost = mean(_finite(state.terms[0])) if state.terms else None
        seconds = time.perf_counter() - begin
        history.append(Passed(stage.name, state.n_step - steps, cost, state.open, seconds))
    return _solution(data, state, tuple(history))


def _finite(cost):
    """Leave out pixels whose events no light explains: log 0 has no cost; their variance is none either, so they are not known."""
    return dr.select(dr.isfinite(cost), cost, 0.0)


def _solution(data: Data, state: State, history: tuple) -> Solution:
    unknowns = data.unknowns(state.theta)
    theta = np.stack([t.numpy() for t in state.theta], axis=-1)
    gain, gain_sigma = None, None
    if unknowns.thresholds:
        gain = np.exp(theta[:, unknowns.n_map :])
        variance = np.diagonal(state.covariance, axis1=1, axis2=2)[:, unknowns.n_map :]
        gain_sigma = np.sqrt(np.maximum(variance, 0))
    n_map = unknowns.n_map
    descents = [passed for passed in history if passed.steps]
    result = SETTLED if not descents or descents[-1].open < OPEN_SHARE else STEPS_USED_UP
    return Solution(
        theta=theta[:, :n_map],
        covariance=state.covariance[:, :n_map, :n_map],
        cost=state.terms[0].numpy(),
        noise=state.noise,
        noise_factor=state.noise_factor,
        n_step=state.n_step,
        result=result if (data.pairs.counts > len(theta[0])).any() else NO_INFORMATION,
        history=history,
        threshold_gain=gain,
        threshold_gain_sigma=gain_sigma,
        threshold_prior=tuple(float(value[0]) for value in state.spread) or None,
        prior_scale=state.prior_scale,
        curved=state.curved,
    )


# ---------------------------------------------------------------------- where to start


def data_of(model, pairs: PairData, constant_light, grid: Grid, robust: float) -> Data:
    """Collect what is given; arguments as the attributes of `Data`."""
    room = room_for(type(constant_light), dr.width(pairs.threshold_on), model.illumination.n_led)
    return Data(model, pairs, constant_light, grid, robust, room)


def start_of(data: Data, theta: list, n_early: int | None = None, spread: tuple | None = None) -> State:
    """Start from unknowns.

    Parameters
    ----------
    theta : list of Float
        See `unknowns`; with the logarithms of the thresholds' factors these are unknown.
    n_early : int, optional
        Events of a pixel that count until `AllPairs`; all by default.
    spread : tuple of 4 float, optional
        What an earlier solution found of the thresholds' distribution.
    """
    Float = type(data.constant_light)
    thresholds = data.unknowns(theta).thresholds
    pairs = thin(data.pairs, n_early) if n_early else data.pairs
    softness = dr.opaque(Float, data.model.illumination.horizon)
    return State(theta, first_spread(Float, spread) if thresholds else [], pairs=pairs, softness=softness)


def resume(
    data: Data, solution: Solution, n_early: int | None = None, theta: np.ndarray | None = None
) -> State:
    """Go on from a solution, or from other unknowns (n_pixel, n_unknown); with thresholds unknown if they were."""
    found = columns(type(data.constant_light), solution.all_theta if theta is None else theta)
    spread = solution.threshold_prior
    if theta is not None and spread:
        moved = np.median(theta[:, -2:] - solution.all_theta[:, -2:], axis=0)
        spread = (*(np.array(spread[:2]) + moved), *spread[2:])
    return start_of(data, found, n_early, spread)
