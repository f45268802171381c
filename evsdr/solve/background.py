"""Background activity: events that come by chance, and say nothing but where the pixel looks next.

The light has gone some way f toward the threshold C of such an event, or away from it: relative residuals u = f / C - 1 lie
between -2 and 0, and half of them below -1, where no noise of thresholds brings an event.
"""

from dataclasses import dataclass

import drjit as dr
import numpy as np

from evsdr.frozen import no_garbage_collection
from evsdr.model.arrays import columns
from evsdr.solve.grid import lonely_grid
from evsdr.solve.loss import residuals
from evsdr.solve.noise import MEDIAN_TO_SIGMA
from evsdr.solve.pair_data import PairData, every_pair, only
from evsdr.solve.problem import Problem
from evsdr.solve.solution import Solution

N_PIXEL = 2000  # that show it
AWAY = -1.0  # residual of an event toward which the light has not gone at all
RANGE = 2.0  # of residuals of events that come by chance; derived


@dataclass(frozen=True)
class Activity:
    """How many events come by chance.

    Attributes
    ----------
    share : float
        Of the events of most pixels.
    clumped : float
        How often events toward which the light has not gone come in the same slots of a pixel as others: variance over
        mean of their number in a slot. Of chance it is 1; of light that the model lacks about the number of rounds.
    """

    share: float
    clumped: float


@no_garbage_collection()
def relative_residuals(problem: Problem, solution: Solution) -> np.ndarray:
    """Give u (n_pair,) of all pairs in the order of `every_pair`, by the maps and thresholds of a solution."""
    theta = columns(type(problem.pairs.phases), solution.all_theta)
    gains = [dr.exp(t) for t in theta[2 + problem.illumination.n_band :]] or None
    constant = problem.illumination.constant_light
    return residuals(problem.model, problem.pairs, constant, theta, gains).numpy()


def activity_of(problem: Problem, solution: Solution) -> Activity:
    """Measure the events by chance in most pixels, by some: twice those toward which the light has not gone."""
    row = np.flatnonzero(problem.pairs.counts)
    row = row[:: -(-max(len(row), 1) // N_PIXEL)]
    if len(row) == 0:
        return Activity(0.0, 0.0)
    grid = lonely_grid(len(row), type(problem.pairs.first))
    problem, solution = problem.at(row, grid), solution.at(row)
    pairs, n_slot = problem.pairs, dr.width(problem.pairs.slot_leds) - 1
    k, pixel = (of.numpy() for of in every_pair(pairs))
    away = relative_residuals(problem, solution) < AWAY
    share = 2 * np.median(np.bincount(pixel, away, len(row)) / pairs.counts)
    slot = (np.abs(pairs.phases.numpy().reshape(-1, 2)[k[away], 1]) - 1).astype(np.int64)
    number = np.bincount(pixel[away] * n_slot + slot, minlength=len(row) * n_slot).reshape(-1, n_slot)
    scatter = np.sum(np.square(number - number.mean(axis=1, keepdims=True)))
    return Activity(float(min(share, 1.0)), float(scatter / max(number.sum(), 1)))


def least_residual(u: np.ndarray, activity: Activity) -> float:
    """Give the residual below which an event rather comes by chance than by the light, of residuals u without nan."""
    middle, share = np.median(u), activity.share
    below = np.sort(middle - u[u < middle])
    if len(below) == 0:
        return -np.inf
    chance = 2 * share / (1 + share)  # of those below
    by_light = np.arange(1, 1 + len(below)) / len(below) - chance * below / RANGE
    scatter = MEDIAN_TO_SIGMA * below[np.argmax(by_light >= 0.5 * (1 - chance))]
    odds = RANGE * (1 - share) / (share * scatter * np.sqrt(2 * np.pi))
    return float(middle - scatter * np.sqrt(2 * np.log(max(odds, 1.0))))


def without_chance(problem: Problem, solution: Solution, activity: Activity) -> PairData:
    """Leave out the events that come rather by chance than by the light of a solution; the next ones still start there."""
    u = relative_residuals(problem, solution)
    return only(problem.pairs, u > least_residual(u, activity))
