"""Some pixels that are solved anew under one forward model after another, to compare what the models explain."""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.model.arrays import columns, owned
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing
from evsdr.solve.grid import lonely_grid
from evsdr.solve.levenberg import descend, evaluate
from evsdr.solve.loop import data_of, start_of
from evsdr.solve.loss import scaled
from evsdr.solve.noise import measured
from evsdr.solve.pair_data import thin
from evsdr.solve.problem import Problem
from evsdr.solve.solution import Data
from evsdr.solve.stages import Terms
from evsdr.solve.system import PixelSystem, system_of

MAX_PAIRS = 256  # of a pixel
ROBUST = 3.0  # width of the Cauchy cost in standard deviations
TERMS = Terms(density=True, silence=False)
N_STEP, TOLERANCE = 8, 0.01  # of a descent, see `levenberg.descend`
HELD_BACK = 0.2  # share of a pixel's pairs, its last ones: about a round
MOST_GAIN = 3.0  # in log likelihood that one pixel may have in the decision; guessed
NO_WAY = 1e6  # cost of a pixel under a model by which its events can't be: without any light, say; far above any other


@dataclass(frozen=True)
class Sample:
    """Pixels to be solved.

    Attributes
    ----------
    data : Data
        Of these pixels, with a matt model.
    noise : float
        Standard deviation of the relative residuals.
    view : Array3f, optional
        See `GlossyRing`.
    spread : tuple of 4 float, optional
        How unknown thresholds are distributed, see `start_of`.
    rough : Float, optional
        See `Problem`.
    """

    data: Data
    noise: float
    view: object
    spread: tuple | None = None
    rough: object = None

    @classmethod
    def of(cls, problem: Problem, pixel: np.ndarray, noise: float, spread=None) -> "Sample":
        """Take pixels (n_pixel) of a problem, one of them as often as wanted."""
        UInt32, view = type(problem.pairs.first), problem.view
        index = owned(UInt32, pixel)
        if view is not None and dr.width(view) > 1:
            view = dr.gather(type(view), view, index)
        light = problem.illumination.gather(index)
        pairs, grid = thin(problem.pairs.at(index).events, MAX_PAIRS), lonely_grid(len(pixel), UInt32)
        data = data_of(LambertianRing(light), pairs, light.constant_light, grid, ROBUST)
        return cls(data, noise, view, spread, problem.rough)

    def with_thresholds(self, shift: float) -> "Sample":
        """Give the sample with thresholds whose logarithms are larger by `shift`."""
        factor = dr.opaque(type(self.data.constant_light), float(np.exp(shift)))
        pairs = scaled(self.data.pairs, [factor, factor])
        dr.eval(pairs.threshold_on, pairs.threshold_off)
        return replace(self, data=replace(self.data, pairs=pairs))

    @property
    def illumination(self) -> Illumination:
        return self.data.model.illumination

    def solve(self, theta: np.ndarray, model, softness: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Solve all pixels.

        Parameters
        ----------
        theta : (n_pixel, n) float
            Unknowns to start from.
        model : callable
            Forward model.
        softness : float, optional
            Of the horizon; by default that of the LEDs.

        Returns
        -------
        cost : (n_pixel,) float64
        theta : (n_pixel, n) float32
        """
        system, start = self._system(theta, model, softness)
        found, terms, *_ = descend(system, start, N_STEP, TOLERANCE)
        return _finite(terms[0]), np.stack([t.numpy() for t in found], axis=-1)

    def hold_back(
        self, theta: np.ndarray, model, softness: float | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Solve all pixels as `solve`, but without the pairs held back; gives what these then cost (n_pixel) too.

        Returns
        -------
        cost : (n_pixel,) float64
            Of the other pairs.
        cost_held : (n_pixel,) float64
        theta : (n_pixel, n) float32
        """
        system, start = self._system(theta, model, softness)
        Float, count = type(self.data.constant_light), system.pairs.counts
        number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        told = number < np.repeat((1 - HELD_BACK) * count, count)
        part, whole = (
            replace(system, pairs=replace(system.pairs, weight=owned(Float, weight)))
            for weight in (told, np.ones(len(told)))
        )
        found, terms, *_ = descend(part, start, N_STEP, TOLERANCE)
        cost, of_all = _finite(terms[0]), _finite(evaluate(whole, found)[0])
        held = np.where(cost < NO_WAY, of_all - cost, NO_WAY)
        return cost, held, np.stack([t.numpy() for t in found], axis=-1)

    def scatter(self, theta: np.ndarray, model) -> float:
        """Give the standard deviation of the relative residuals of most pixels."""
        data = replace(self.data, model=model)
        return measured(data, start_of(data, columns(type(self.data.constant_light), theta))).noise

    def _system(self, theta: np.ndarray, model, softness: float | None) -> tuple[PixelSystem, list]:
        """Collect what the cost under a model depends on, and the unknowns to start from."""
        Float, data = type(self.data.constant_light), replace(self.data, model=model)
        state = start_of(data, columns(Float, theta), spread=self.spread)
        if softness is not None:
            state = replace(state, softness=dr.opaque(Float, softness))
        return system_of(data, state, TERMS.loss(data), dr.opaque(Float, self.noise)), state.theta


def _finite(value) -> np.ndarray:
    """Give the cost of each pixel, none of it infinite or not a number."""
    return np.minimum(np.nan_to_num(value.numpy().astype(float), nan=NO_WAY), NO_WAY)


def gained(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Compare two models by what pairs held back cost (n_pixel) under either.

    By Vuong's test ("Likelihood ratio tests for model selection", Econometrica 1989), in which no pixel counts for more than
    `MOST_GAIN`.

    Returns
    -------
    z : float
        What the second gains in log likelihood, in standard deviations by its scatter over the pixels.
    mean : float
        The same, of a pixel.
    """
    gain = np.clip(before - after, -MOST_GAIN, MOST_GAIN)
    return float(gain.sum() / np.sqrt(max(np.sum(gain**2), 1e-12))), float(gain.sum() / max(len(gain), 1))
