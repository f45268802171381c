"""Stages of a solve that learn numbers from the pixels: thresholds' spread, noise, and what neighbours have in common."""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.model.arrays import owned
from evsdr.solve import triangles
from evsdr.solve.levenberg import descended, evaluate, split
from evsdr.solve.neighbours.posterior import Priors, find_posterior
from evsdr.solve.noise import IGNORED, NOISE_RANGE, measured, noise_factors, scatter_of, slot_factors, slotted
from evsdr.solve.pair_data import without
from evsdr.solve.solution import Data, State
from evsdr.solve.stages import ALL_TERMS, Terms, softness_at
from evsdr.solve.system import system_of
from evsdr.solve.threshold_spread import MOVING_SPREAD, learn_spread
from evsdr.solve.tuning import Tuning
from evsdr.solve.unknowns import TIED, fill

# Error of log I, relative to the threshold, by the softness of the horizon; measured: 0.5 to 2 do, 1 gives the best normals of
# spheres and of bumpy meshes, on ideal recordings and on those of an EVK4
CURVED_LIGHT = 1.0
MEAN_SETTLED = 0.002  # change of the mean log thresholds in a round


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
            loss = self.terms.loss(data)
            state = descended(data, state, loss, self.n_step, self.tolerance, self.name, progress)
            parts = split(state.terms, len(state.theta))
            spread = learn_spread(
                state.theta, *parts, state.spread, curvature(data, state.theta), MOVING_SPREAD
            )
            moved = max(abs(float(a[0] - b[0])) for a, b in zip(spread[:2], state.spread[:2]))
            state = replace(state, spread=spread)
            if progress(self.name, (round_ + 1) / self.n_round) or moved < MEAN_SETTLED:
                break
        return state


@dataclass(frozen=True)
class Respread:
    """Take the noise of the events and the distribution of unknown thresholds from all events, and descend on them.

    Attributes
    ----------
    n_step, tolerance
        See `Descend`.
    n_round : int
        How often at most; it ends when both means have settled.
    terms : Terms
    """

    n_step: int
    tolerance: float
    terms: Terms = ALL_TERMS
    n_round: int = 3
    name: str = "spread"

    def __call__(self, data, state, progress):
        if not state.spread:
            return state
        loss = self.terms.loss(data)
        for round_ in range(self.n_round):
            state = measured(data, state)
            terms = evaluate(system_of(data, state, loss), state.theta)
            parts = split(terms, len(state.theta))
            spread = learn_spread(state.theta, *parts, state.spread, curvature(data, state.theta))
            moved = max(abs(float(a[0] - b[0])) for a, b in zip(spread[:2], state.spread[:2]))
            state = replace(state, spread=spread)
            state = descended(data, state, loss, self.n_step, self.tolerance, self.name, progress)
            if progress(self.name, (round_ + 1) / self.n_round) or moved < MEAN_SETTLED:
                break
        return state


def curvature(data: Data, theta: list) -> np.ndarray:
    """Give how curved the surface is within each pixel (n_pixel,), see `learn_spread`."""
    return np.square(softness_at(data, theta).numpy().astype(float))


def curved_factors(data: Data, state: State) -> np.ndarray:
    """Say by which factor (n_pixel,) float32 the noise of a pixel counts as larger, since its surface is curved.

    Of the light of LEDs near the horizon the model is off by about the horizon's softness, and by as much in each round:
    for n events of a slot that noise of the variance s^2 shows through as s^2 / n, an error e of them all is noise of the
    variance s^2 + n e^2. What it does to the maps, their own matrix tells. Where residuals are as small as can be, pixels
    have no more events than unknowns, and the noise is not known: it stays.
    """
    if state.noise <= NOISE_RANGE[0]:
        return np.ones(len(state.per_slot), np.float32)
    wrong = CURVED_LIGHT**2 * curvature(data, state.theta)
    return np.sqrt(1 + state.per_slot * wrong / state.noise**2).astype(np.float32)


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
        factor, slots = np.ones(n_pixel, np.float32), slotted(data, state)
        if self.misfit:
            factor = noise_factors(scatter, state.noise, n_pixel, len(state.theta), self.misfit)
            if state.noise > NOISE_RANGE[0]:
                factor = np.maximum(factor, slot_factors(slots))
        pairs = state.pairs
        if (factor == IGNORED).any():
            pairs = without(pairs, factor == IGNORED)
        per_slot = state.pairs.counts / np.maximum(slots.n_group, 1)
        return replace(state, noise_factor=factor, per_slot=per_slot, pairs=pairs, terms=[cost])


@dataclass(frozen=True)
class Neighbours:
    """Let pixels learn from each other; without priors each stays alone, and only sigmas are worked out.

    Attributes
    ----------
    priors : Priors, optional
    terms : Terms
    curved : bool
        Whether surfaces may be curved within a pixel, see `curved_factors`.
    """

    priors: Priors | None = None
    terms: Terms = ALL_TERMS
    curved: bool = True
    name: str = "neighbours"

    def __call__(self, data, state, progress):
        factor = state.noise_factor * (curved_factors(data, state) if self.curved else 1)
        noise = owned(type(data.constant_light), state.noise * factor)
        weak = 1.0 if self.priors is None else 1 / min(dr.width(noise), TIED)
        system = system_of(data, state, self.terms.loss(data), noise, weak)
        n, cost = len(state.theta), state.terms[0]
        if self.priors is None:
            matrix = split(evaluate(system, state.theta), n)[1]
            covariance = triangles.inverse_of(triangles.block(matrix, range(n), slice(None)))
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
