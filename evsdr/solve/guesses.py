"""Guesses of what pixels see of the LEDs: what they cost, and which to try.

Costs are negative logarithms of likelihoods.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.frozen import no_garbage_collection
from evsdr.model.arrays import columns, owned
from evsdr.progress import never
from evsdr.solve.grid import lonely_grid
from evsdr.solve.levenberg import descend
from evsdr.solve.loop import data_of, start_of
from evsdr.solve.pair_data import PairData
from evsdr.solve.problem import Problem
from evsdr.solve.recipes import Effort
from evsdr.solve.solution import Solution
from evsdr.solve.stages import ALL_TERMS, PAIRS, Terms
from evsdr.solve.system import system_of

# Of each arc of LEDs that are hidden, or traced otherwise; guessed: 3 to 30 make no difference
ARC = 6.0
PARTIAL = 2.0  # of each LED that is seen in part, if not traced so; guessed: 1 and 3 make no difference
# Of each LED that is traced otherwise. Measured, 48 pixels: with 6 on known surfaces a forgotten pole is left at 0.45 degrees, with
# 1.5 at 0.34; where all is told, reliefs, a goathead and a pole are alike, a skull has 2.1 and 2.2
MISMATCH = 1.5
LENGTHS = 1 / 12, 1 / 6, 1 / 3, 1 / 2, 3 / 4  # of arcs, of the ring
# Places where arcs begin. Measured, 64 pixels: with 8 in place of 24 the lion comes out at 5.26 degrees for 4.94; a goathead and
# Nefertiti gain nothing
N_BEGIN = 24
SHARES = 0.2, 0.5, 0.8  # of LEDs at the ends of an arc
N_CHANGE = 48  # guesses that `changes` gives, about
AT_ONCE = 60_000  # guesses that are solved together
TOLERANCE = 0.1  # gain in log likelihood that is worth a step
IMPOSSIBLE = 1e9  # cost of a guess under which the events can't be, in place of infinity, so that differences stay numbers
RACED = 2  # steps of a race; measured: 1 to 3 alike
WITHOUT_SILENCE = Terms(silence=False)  # which takes three quarters of a step


@dataclass(frozen=True)
class Guess:
    """The best so far: visibility (n_led, n_pixel), unknowns (n_pixel, n_unknown) and cost (n_pixel)."""

    share: np.ndarray
    theta: np.ndarray
    cost: np.ndarray

    def better(self, pixel: np.ndarray, share: np.ndarray, theta: np.ndarray, cost: np.ndarray) -> "Guess":
        """Take over what costs less; a pixel may be named several times."""
        order = np.lexsort((cost, pixel))
        k = order[np.unique(pixel[order], return_index=True)[1]]
        k = k[cost[k] < self.cost[pixel[k]]]
        new = Guess(self.share.copy(), self.theta.copy(), self.cost.copy())
        new.share[:, pixel[k]], new.theta[pixel[k]], new.cost[pixel[k]] = share[:, k], theta[k], cost[k]
        return new


@dataclass(frozen=True)
class Judge:
    """Fits maps to guesses of the visibility, and tells what they cost.

    Attributes
    ----------
    problem : Problem
        Under light that nothing hides.
    pairs : PairData
        The events that count.
    solution : Solution
        For noise and thresholds.
    order : (n_led,) int
        LEDs by azimuth.
    traced : (n_led, n_pixel) float, optional
        What tracing says of the visibility.
    facing : (n_led, n_pixel) bool, optional
        Where that counts.
    known : bool
        Whether it was traced on a known surface.
    enough : callable () -> bool
        Says whether to end soon.
    """

    problem: Problem
    pairs: PairData
    solution: Solution
    order: np.ndarray
    traced: np.ndarray | None = None
    facing: np.ndarray | None = None
    known: bool = False
    enough: Callable[[], bool] = never

    def prior(self, pixel: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Give what guesses cost before any event is heard: for each departure from what is traced."""
        off = 1 - share if self.traced is None else (self.traced[:, pixel] - share) * self.facing[:, pixel]
        ring = off[self.order]
        arcs = np.abs(ring - np.roll(ring, 1, axis=0)).sum(axis=0) / 2
        partial = (share > 0) & (share < 1) & (off != 0)
        cost = ARC * arcs + PARTIAL * partial.sum(axis=0)
        if self.traced is not None:
            cost += MISMATCH * np.abs(off).sum(axis=0)
        return cost

    def __call__(self, pixel: np.ndarray, share: np.ndarray, theta: np.ndarray, descents: tuple) -> tuple:
        """Fit guesses: of pixels (n), visibilities (n_led, n), from unknowns (n, n_unknown); gives unknowns and costs."""
        theta, cost = self._fit(pixel, share, theta, descents, ALL_TERMS)
        return theta, cost + self.prior(pixel, share)

    def race(
        self, pixel: np.ndarray, share: np.ndarray, theta: np.ndarray, descents: tuple, most: int
    ) -> tuple:
        """Fit guesses, and drop all but so many of each pixel soon: those that cost least after few steps without silence.

        Arguments as when called; gives those of `Guess.better`.
        """
        first = ((descents[0][0], RACED),)
        cost = self._fit(pixel, share, theta, first, WITHOUT_SILENCE)[1] + self.prior(pixel, share)
        k = cheapest(pixel, cost, most)
        pixel, share = pixel[k], share[:, k]
        return pixel, share, *self(pixel, share, theta[k], descents)

    def rougher(self, factor: float) -> "Judge":
        """Take the noise for so many times as large."""
        return replace(self, solution=replace(self.solution, noise=factor * self.solution.noise))

    def misfit(self, pixel: np.ndarray, guess: "Guess") -> np.ndarray:
        """Give what the pairs of pixels cost."""
        given = pixel, guess.share[:, pixel], guess.theta[pixel], ((None, 0),)
        return self._fit(*given, PAIRS)[1]

    @no_garbage_collection()
    def _fit(self, pixel, share, theta, descents, terms):
        if len(pixel) == 1:  # it goes twice, as Dr.Jit has kernels of their own for one value
            twice = np.zeros(2, int)
            theta, cost = self._fit(pixel[twice], share[:, twice], theta[twice], descents, terms)
            return theta[:1], cost[:1]
        theta, cost = theta.copy(), np.zeros(len(pixel))
        order = np.argsort(
            pixel, kind="stable"
        )  # guesses of a pixel hear the same events: side by side they do so at once
        for begin in range(0, len(pixel), AT_ONCE):
            k = order[begin : begin + AT_ONCE]
            theta[k], cost[k] = self._fit_some(pixel[k], share[:, k], theta[k], descents, terms)
        return theta, cost

    def _fit_some(self, pixel, share, theta, descents, which):
        light, UInt32 = self.problem.illumination, type(self.pairs.first)
        Float = type(light.constant_light)
        index = owned(UInt32, pixel)
        model = self.problem.model_at(index)
        model = replace(model, illumination=model.illumination.seen(share))
        grid = lonely_grid(len(pixel), UInt32)
        width = Effort().width(self.solution.threshold_gain is not None)
        data = data_of(model, self.pairs.at(index), light.constant_light, grid, width)
        theta = columns(Float, theta)
        state = replace(start_of(data, theta, None, self.solution.threshold_prior), noise=self.solution.noise)
        for softness, n_step in descents:
            softness = dr.opaque(Float, light.horizon if softness is None else softness)
            system = system_of(data, replace(state, softness=softness), which.loss(data))
            theta, terms, *_ = descend(system, theta, n_step, TOLERANCE)
        cost = np.nan_to_num(terms[0].numpy(), nan=IMPOSSIBLE)
        return np.stack([t.numpy() for t in theta], axis=-1), np.minimum(cost, IMPOSSIBLE)


def cheapest(pixel: np.ndarray, cost: np.ndarray, most: int) -> np.ndarray:
    """Give which guesses are among so many of their pixel's that cost least."""
    order = np.lexsort((cost, pixel))
    of = pixel[order]
    rank = np.arange(len(of)) - np.searchsorted(of, of)
    return np.sort(order[rank < most])


def arcs(order: np.ndarray, n_begin: int = N_BEGIN) -> np.ndarray:
    """Give visibilities (n_arc, n_led) with one arc of hidden LEDs, from so many places; in the first all are seen."""
    n_led = len(order)
    out = [np.ones(n_led, np.float32)]
    for length in sorted({max(1, round(share * n_led)) for share in LENGTHS} - {n_led}):
        for begin in range(0, n_led, max(1, n_led // n_begin)):
            seen = np.ones(n_led, np.float32)
            seen[order[(begin + np.arange(length)) % n_led]] = 0
            out.append(seen)
    return np.array(out)


def changes(share: np.ndarray) -> list[np.ndarray]:
    """Give small changes of visibilities (n_led, n), LEDs in order of azimuth."""
    before, after = np.roll(share, 1, axis=0), np.roll(share, -1, axis=0)
    out = [choose(share, other) for choose in (np.minimum, np.maximum) for other in (before, after)]
    out += [(share + other) / 2 for other in out]
    out += [before, after, (before + 2 * share + after) / 4]
    for other in (before, after):
        for dim in (share < 0.5) & (other >= 0.5), (share >= 0.5) & (other < 0.5):
            out += [np.where(dim, np.float32(part), share) for part in SHARES]
    size = max(1, len(share) // 24)
    for begin in range(0, len(share), size):
        flipped = share.copy()
        flipped[begin : begin + size] = share[begin : begin + size] < 0.5
        out.append(flipped)
    return out
