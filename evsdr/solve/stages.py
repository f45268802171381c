"""Stages of a solve that move the unknowns of the pixels; those in `learning` find what pixels have in common.

Each stage is a record of how hard it tries, and a function from state to state.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import drjit as dr

from evsdr.progress import Progress
from evsdr.solve.grid import NEXT
from evsdr.solve.levenberg import OPEN_SHARE, descend, descended, gather, horizon, keep_better
from evsdr.solve.loss import Loss
from evsdr.solve.noise import measured
from evsdr.solve.solution import Data, State
from evsdr.solve.system import system_of


class Stage(Protocol):
    """One step of a recipe."""

    name: str

    def __call__(self, data: Data, state: State, progress: Progress) -> State:
        """Give a new state, soon if `progress` gives True."""


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
        return descended(data, state, self.terms.loss(data), self.n_step, self.tolerance, self.name, progress)


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
        system, made, enough = system_of(data, state, PAIRS.loss(data)), 0, False
        theta, terms = state.theta, state.terms
        for sweep in range(self.n_sweep):
            before = terms[0]
            for i, place in enumerate(NEXT):
                candidate = gather(theta, data.grid.links.index[place])
                *candidate, n, _ = descend(system, candidate, self.n_try, self.tolerance)
                theta, terms = keep_better(theta, terms, *candidate)
                made += n
                enough = progress(self.name, (sweep + (i + 1) / len(NEXT)) / self.n_sweep)
                if enough:
                    break
            gained = mean(dr.select(before - terms[0] > self.tolerance, type(before)(1.0), 0.0))
            if enough or gained < OPEN_SHARE:
                break
        return replace(state, theta=theta, terms=terms, n_step=state.n_step + made)


@dataclass(frozen=True)
class AllPairs:
    """From here on all pairs count."""

    name: str = "all events"

    def __call__(self, data, state, progress):
        return replace(state, pairs=data.pairs, terms=None)


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
        loss = self.terms.loss(data)
        curved = descended(data, curved, loss, self.n_step, self.tolerance, self.name, progress)
        gain = float(dr.sum(state.terms[0] - curved.terms[0])[0])
        return curved if gain > 0 else replace(state, n_step=curved.n_step)


def softness_at(data: Data, theta: list):
    """Give each pixel's softness of the horizon, as its surface is curved."""
    hard = dr.opaque(type(data.constant_light), data.model.illumination.horizon)
    return horizon(theta, data.grid.links, hard)


def mean(values) -> float:
    """Give the mean of an array; the kernel of `dr.mean` would hold its size."""
    return float(dr.sum(values)[0]) / dr.width(values)
