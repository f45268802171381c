"""The stages of a solve, and the loop that runs them: a recipe is a tuple of stages.

Each stage is a record of how hard it tries, and a function from state to state.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import drjit as dr
import numpy as np

from evsdr.frozen import no_garbage_collection
from evsdr.model.arrays import columns, owned
from evsdr.solve import triangles
from evsdr.solve.grid import NEXT, Grid
from evsdr.solve.levenberg import (
    OPEN_SHARE,
    descend,
    descended,
    evaluate,
    gather,
    horizon,
    keep_better,
    split,
    system_of,
)
from evsdr.solve.loss import Loss
from evsdr.solve.neighbours.posterior import Priors, find_posterior
from evsdr.solve.noise import IGNORED, measured, noise_factors, scatter_of
from evsdr.solve.pair_data import PairData, room_for, thin, without
from evsdr.solve.solution import NO_INFORMATION, SETTLED, STEPS_USED_UP, Data, Passed, Solution, State
from evsdr.solve.threshold_spread import MOVING_SPREAD, first_spread, learn_spread
from evsdr.solve.tuning import Tuning
from evsdr.solve.unknowns import fill

Progress = Callable[[str, float], None]


class Stage(Protocol):
    """One step of a recipe."""

    name: str

    def __call__(self, data: Data, state: State, progress: Progress) -> State:
        """Give a new state."""


@dataclass(frozen=True)
class Terms:
    """What counts beside event pairs: the density of event times, and that no event fired."""

    density: bool = True
    silence: bool = True

    def loss(self, data: Data) -> Loss:
        return Loss(data.robust, self.density, self.silence)


PAIRS, ALL_TERMS = Terms(False, False), Terms()


@dataclass(frozen=True)
class Descend:
    """Descend by Levenberg-Marquardt steps.

    Attributes
    ----------
    n_step : int
        Steps at most.
    tolerance : float
        Gain in log likelihood of a pixel that is worth a step.
    softness : float, optional
        Width of the smooth horizon; by default that of the LEDs.
    noise : float, optional
        Standard deviation of the relative residual; measured by default.
    terms : Terms
    """

    n_step: int
    tolerance: float
    softness: float | None = None
    noise: float | None = None
    terms: Terms = PAIRS
    name: str = "descent"

    def __call__(self, data, state, progress):
        softness = data.model.illumination.horizon if self.softness is None else self.softness
        state = replace(state, softness=dr.opaque(type(data.constant_light), softness))
        state = measured(data, state) if self.noise is None else replace(state, noise=self.noise)
        told = lambda share: progress(self.name, share)  # noqa: E731
        return descended(data, state, self.terms.loss(data), self.n_step, self.tolerance, told)


@dataclass(frozen=True)
class Starts:
    """Let each pixel try the solutions of its four neighbours.

    Attributes
    ----------
    n_sweep : int
        Rounds over the neighbours at most; they end when hardly a pixel takes one over.
    n_try : int
        Steps granted to a start before it is compared.
    tolerance : float
        See `Descend`.
    """

    n_sweep: int
    n_try: int
    tolerance: float
    name: str = "starts"

    def __call__(self, data, state, progress):
        system, made = system_of(data, state, PAIRS.loss(data)), 0
        theta, terms = state.theta, state.terms
        for sweep in range(self.n_sweep):
            before = terms[0]
            for i, place in enumerate(NEXT):
                candidate = gather(theta, data.grid.links.index[place])
                *candidate, n, _ = descend(system, candidate, self.n_try, self.tolerance)
                theta, terms = keep_better(theta, terms, *candidate)
                made += n
                progress(self.name, (sweep + (i + 1) / len(NEXT)) / self.n_sweep)
            gained = mean(dr.select(before - terms[0] > self.tolerance, type(before)(1.0), 0.0))
            if gained < OPEN_SHARE:
                break
        return replace(state, theta=theta, terms=terms, n_step=state.n_step + made)


@dataclass(frozen=True)
class ThresholdSpread:
    """Find how unknown thresholds are distributed over the pixels.

    Attributes
    ----------
    n_round : int
        Rounds of expectation maximisation at most; they end when both means have settled.
    n_step : int
        Descent of each round.
    tolerance : float
        See `Descend`; also the change of a mean, relative to the spread, that is worth a round.
    """

    n_round: int
    n_step: int
    tolerance: float
    terms: Terms = ALL_TERMS
    name: str = "thresholds"

    def __call__(self, data, state, progress):
        if not state.spread:
            return state
        for round_ in range(self.n_round):
            state = measured(data, state)
            state = descended(data, state, self.terms.loss(data), self.n_step, self.tolerance, _silent)
            _, matrix = split(state.terms, len(state.theta))
            spread = learn_spread(state.theta, matrix, state.spread, MOVING_SPREAD)
            moved = max(abs(float(a[0] - b[0])) for a, b in zip(spread[:2], state.spread[:2]))
            state = replace(state, spread=spread)
            progress(self.name, (round_ + 1) / self.n_round)
            if moved < MEAN_SETTLED:
                break
        return state


MEAN_SETTLED = 0.002  # change of the mean log thresholds in a round


@dataclass(frozen=True)
class HearAll:
    """From here on all pairs count."""

    name: str = "all events"

    def __call__(self, data, state, progress):
        return replace(state, pairs=data.pairs, terms=None)


@dataclass(frozen=True)
class Respread:
    """Take the distribution of unknown thresholds from all events, and descend on it.

    Attributes
    ----------
    n_step, tolerance
        See `Descend`.
    fired_lower : float
        See `Tuning`.
    terms : Terms
    """

    n_step: int
    tolerance: float
    fired_lower: float = 1.0
    terms: Terms = ALL_TERMS
    name: str = "spread"

    def __call__(self, data, state, progress):
        if not state.spread:
            return state
        _, matrix = split(state.terms, len(state.theta))
        shift = self.fired_lower * state.noise**2
        state = replace(state, spread=learn_spread(state.theta, matrix, state.spread, shift=shift))
        return descended(data, state, self.terms.loss(data), self.n_step, self.tolerance, _silent)


@dataclass(frozen=True)
class SoftHorizon:
    """Let the horizon be as soft as the surface is curved within a pixel, if the events agree.

    Attributes
    ----------
    n_step, tolerance
        See `Descend`.
    """

    n_step: int
    tolerance: float
    terms: Terms = ALL_TERMS
    name: str = "soft horizon"

    def __call__(self, data, state, progress):
        curved = replace(state, softness=softness_at(data, state.theta), curved=True)
        curved = descended(data, curved, self.terms.loss(data), self.n_step, self.tolerance, _silent)
        gain = float(dr.sum(state.terms[0] - curved.terms[0])[0])
        return curved if gain > 0 else replace(state, n_step=curved.n_step)


def softness_at(data: Data, theta: list):
    """Give each pixel's softness of the horizon, as its surface is curved."""
    hard = dr.opaque(type(data.constant_light), data.model.illumination.horizon)
    return horizon(theta, data.grid.links, hard)


@dataclass(frozen=True)
class PixelNoise:
    """Give each pixel its own noise, and leave out those whose events contradict the light.

    Attributes
    ----------
    terms : Terms
    misfit : float, optional
        See `Tuning`; without it pixels don't differ.
    """

    terms: Terms = ALL_TERMS
    misfit: float | None = Tuning.misfit
    name: str = "noise"

    def __call__(self, data, state, progress):
        scatter, n_pixel = scatter_of(data, state), dr.width(state.theta[0])
        state = replace(state, noise=scatter.of_most())
        cost = evaluate(system_of(data, state, self.terms.loss(data)), state.theta)[0]
        factor = np.ones(n_pixel, np.float32)
        if self.misfit:
            factor = noise_factors(scatter, state.noise, n_pixel, len(state.theta), self.misfit)
        pairs = state.pairs
        if (factor == IGNORED).any():
            pairs = without(pairs, factor == IGNORED)
        return replace(state, noise_factor=factor, pairs=pairs, terms=[cost])


@dataclass(frozen=True)
class Neighbours:
    """Let pixels learn from each other; without priors each stays alone, and only sigmas are worked out.

    Attributes
    ----------
    priors : Priors, optional
    terms : Terms
    """

    priors: Priors | None = None
    terms: Terms = ALL_TERMS
    name: str = "neighbours"

    def __call__(self, data, state, progress):
        noise = owned(type(data.constant_light), state.noise * state.noise_factor)
        system = system_of(data, state, self.terms.loss(data), noise)
        n, cost = len(state.theta), state.terms[0]
        if self.priors is None:
            matrix = split(evaluate(system, state.theta), n)[1]
            covariance = np.linalg.inv(triangles.block(matrix, range(n), slice(None)))
            return replace(state, covariance=covariance)
        good = (state.noise_factor < IGNORED) & (data.pairs.counts > 0)
        theta = fill(state.theta, good, data.grid.mask)

        def terms_at(theta):
            softness = softness_at(data, theta) if state.curved else state.softness
            terms = evaluate(replace(system, softness=softness), theta)
            return terms[0], *split(terms, n)

        found = find_posterior(theta, terms_at, data.grid, system.unknowns, self.priors, progress)
        more = dict(covariance=found.covariance, prior_scale=found.scale, open=found.open)
        return replace(state, theta=found.theta, terms=[cost], n_step=state.n_step + found.n_round, **more)


def mean(values) -> float:
    """Give the mean of an array; the kernel of `dr.mean` would hold its size."""
    return float(dr.sum(values)[0]) / dr.width(values)


def _silent(*_) -> None:
    """Tell nobody."""


@no_garbage_collection()
def solve(data: Data, recipe: tuple[Stage, ...], start: State, progress: Progress = _silent) -> Solution:
    """Run the stages of a recipe one after another.

    Parameters
    ----------
    data : Data
        What is given.
    recipe : tuple of Stage
        See `recipes`; the last ones must be `PixelNoise` and `Neighbours`.
    start : State
        See `start_of` and `resume`.
    progress : callable (stage, share)
        Told what is done, share 0..1.

    Returns
    -------
    Solution
    """
    state, history = start, []
    for stage in recipe:
        begin, steps = time.perf_counter(), state.n_step
        state = stage(data, replace(state, open=0.0), progress)
        dr.eval(state.theta, state.terms)
        cost = mean(state.terms[0]) if state.terms else None
        seconds = time.perf_counter() - begin
        history.append(Passed(stage.name, state.n_step - steps, cost, state.open, seconds))
    return _solution(data, state, tuple(history))


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
    )


# ---------------------------------------------------------------------- where to start


def data_of(model, pairs: PairData, constant_light, grid: Grid, robust: float) -> Data:
    """Collect what is given; arguments as the attributes of `Data`."""
    room = room_for(type(constant_light), dr.width(pairs.threshold_on), model.illumination.n_led)
    return Data(model, pairs, constant_light, grid, robust, room)


def start_of(data: Data, theta: list, n_heard: int | None = None, spread: tuple | None = None) -> State:
    """Start from unknowns.

    Parameters
    ----------
    theta : list of Float
        See `unknowns`; with the logarithms of the thresholds' factors these are unknown.
    n_heard : int, optional
        Events of a pixel that count until `HearAll`; all by default.
    spread : tuple of 4 float, optional
        What an earlier solution found of the thresholds' distribution.
    """
    Float = type(data.constant_light)
    thresholds = data.unknowns(theta).thresholds
    pairs = thin(data.pairs, n_heard) if n_heard else data.pairs
    softness = dr.opaque(Float, data.model.illumination.horizon)
    return State(theta, first_spread(Float, spread) if thresholds else [], pairs=pairs, softness=softness)


def resume(data: Data, solution: Solution, n_heard: int | None = None) -> State:
    """Go on from a solution, with thresholds unknown if they were."""
    theta = columns(type(data.constant_light), solution.all_theta)
    return start_of(data, theta, n_heard, solution.threshold_prior)
