"""Levenberg-Marquardt on all pixels at once: each has its own damping and accepts or rejects its own step.

The functions are recorded once and then run for any number of pixels (`dr.freeze`); whatever changes from recording
to recording is an argument, and an array. The forward model is a callable; nothing here knows Mitsuba.
"""

from collections.abc import Callable
from dataclasses import replace

import drjit as dr
import numpy as np

from evsdr.frozen import recorded
from evsdr.model.arrays import owned, picked
from evsdr.model.illumination import pixel_horizon
from evsdr.progress import Progress, silent
from evsdr.solve import triangles
from evsdr.solve.loss import Loss, pixel_terms
from evsdr.solve.solution import Data, State
from evsdr.solve.system import PixelSystem, system_of

FIRST_DAMPING = 1e-2
DAMPING_RANGE = (1e-6, 1e6)
SHRINK, GROW = 0.25, 6.0  # of the damping after a step that was accepted, or rejected
# Steps without a gain after which a pixel rests (measured, balanced on a blob of 128 x 128: 1, 2, 4 give 0.24, 0.25, 0.25
# degrees in 22, 18, 22 CPU seconds); pixels from which on, and share of them below which, only the others go on: guessed
PATIENCE, FEWEST, WORTH = 2, 4096, 0.7
BLOCK = 512  # pixels whose pairs lie together; measured: 128 to 2048 and all pixels alike, the image's order 20 % slower
OPEN_SHARE = 0.005  # of the pixels: when fewer still gain, the others are not worth a step of all


def evaluate(system: PixelSystem, theta: list) -> list:
    """Give cost, gradient and lower triangle of the Gauss-Newton matrix, weak prior included."""
    pixel = by_count(system)
    if pixel is None:
        return _evaluate(system, theta)
    return placed([_evaluate(system.at(pixel), picked(theta, pixel))], pixel, dr.width(theta[0]))[0]


@recorded
def _evaluate(system: PixelSystem, theta: list) -> list:
    return _terms(system, theta)


def _terms(system: PixelSystem, theta: list) -> list:
    cost, gradient, matrix = pixel_terms(system, theta)
    more = system.unknowns.prior(theta, system.spread, system.weak)
    return [cost + more[0], *(a + b for a, b in zip(gradient, more[1])), *triangles.added(matrix, more[2])]


@recorded
def step(system: PixelSystem, theta: list, terms: list, damping, idle, tolerance):
    """Make one step; each pixel keeps what lowers its own cost.

    Returns
    -------
    theta, terms, damping
        Anew.
    idle : Float, (n_pixel)
        For how many steps the cost has not fallen by more than the tolerance.
    gaining : Float, width 1
        Number of pixels whose cost fell by more than the tolerance.
    """
    gradient, matrix = split(terms, len(theta))
    move = triangles.solve(*triangles.factor(matrix, damping), [-g for g in gradient])
    trial = system.unknowns.moved(theta, move)
    dr.eval(trial)
    new_terms = _terms(system, trial)
    fallen = terms[0] - new_terms[0]
    better = fallen > 0
    Float = type(fallen)
    gains = fallen > tolerance
    theta = [dr.select(better, new, old) for new, old in zip(trial, theta)]
    terms = [dr.select(better, new, old) for new, old in zip(new_terms, terms)]
    damping = dr.clip(damping * dr.select(better, SHRINK, GROW), *DAMPING_RANGE)
    idle = dr.select(gains, Float(0.0), idle + 1.0)
    gaining = dr.select(gains, Float(1.0), 0.0)
    dr.eval(theta, terms, damping, idle, gaining)  # at once: a sum alone would evaluate the terms for itself
    return theta, terms, damping, idle, dr.sum(gaining)


@recorded
def keep_better(theta: list, terms: list, candidate: list, candidate_terms: list):
    """Give each pixel the solution of smaller cost."""
    better = candidate_terms[0] < terms[0]
    theta = [dr.select(better, new, old) for new, old in zip(candidate, theta)]
    return theta, [dr.select(better, new, old) for new, old in zip(candidate_terms, terms)]


@recorded
def gather(theta: list, index) -> list:
    """Give each pixel the unknowns of another."""
    return [dr.gather(type(t), t, index) for t in theta]


@recorded
def horizon(theta: list, links, hard):
    """Give each pixel's softness (see `lambert.soft_max0`): as its surface is curved within it."""
    return dr.sqrt(dr.square(pixel_horizon(theta[0], theta[1], links)) + hard * hard)


def split(terms: list, n: int) -> tuple[list, list]:
    """Give gradient and matrix of terms."""
    return list(terms[1 : 1 + n]), list(terms[1 + n :])


def descend(
    system: PixelSystem,
    theta: list,
    n_step: int,
    tolerance: float,
    progress: Callable[[float], bool | None] = silent,
) -> tuple[list, list, int, float]:
    """Make steps until hardly a pixel gains, they are used up, or `progress` gives True.

    Parameters
    ----------
    tolerance : float
        Gain in log likelihood of a pixel that is worth a step.

    Returns
    -------
    theta, terms : list of Float
    made : int
        Steps.
    open : float
        Share of the pixels that gained more than the tolerance in the last one.
    """
    Float, n_pixel = type(theta[0]), dr.width(theta[0])
    whole, pixel, found = system, by_count(system), None
    system, theta = (whole, list(theta)) if pixel is None else (whole.at(pixel), picked(theta, pixel))
    here = [theta, _evaluate(system, theta)]
    damping = dr.zeros(Float, n_pixel) + dr.opaque(Float, FIRST_DAMPING)
    idle, enough = dr.zeros(Float, n_pixel), dr.opaque(Float, tolerance)
    dr.make_opaque(damping, idle)
    made, still_open = 0, 0.0
    while made < n_step:
        *here, damping, idle, gaining = step(system, *here, damping, idle, enough)
        made, still_open = made + 1, float(gaining[0]) / n_pixel  # waits, so that Ctrl-C is heard
        if progress(made / n_step) or still_open < OPEN_SHARE:
            break
        left = None if pixel is None else dr.compress(idle < PATIENCE)
        if left is not None and FEWEST // 2 <= dr.width(left) < WORTH * dr.width(idle):
            found, pixel = placed(here, pixel, n_pixel, found), dr.gather(type(left), pixel, left)
            system, (here, damping, idle) = whole.at(pixel), picked((here, damping, idle), left)
            dr.eval(pixel, here, damping, idle)
    return *placed(here, pixel, n_pixel, found), made, still_open


def by_count(system: PixelSystem):
    """Give the pixels, UInt32 (n_pixel), in blocks, in each those of most pairs first; None where they are few.

    Neighbours in an array are worked on together, and wait for the one that has most.
    """
    count = system.pairs.counts
    if len(count) < FEWEST:
        return None
    order = np.lexsort((-count, np.arange(len(count)) // BLOCK))
    return owned(type(system.pairs.first), order)


def placed(here: list, pixel, n_pixel: int, found: list | None = None) -> list:
    """Put lists of what some pixels found, UInt32 (n), among what all did; None stands for all pixels."""
    if pixel is None:
        return here

    def put(part, whole):
        out = dr.zeros(type(part), n_pixel) if whole is None else type(part)(whole)
        dr.scatter(out, part, pixel, mode=dr.ReduceMode.Permute)
        return out

    found = found or [[None] * len(parts) for parts in here]
    out = [[put(*both) for both in zip(*lists)] for lists in zip(here, found)]
    dr.eval(out)
    return out


def descended(
    data: Data, state: State, loss: Loss, n_step: int, tolerance: float, name: str, progress: Progress
) -> State:
    """Descend from a state on the pairs that it hears; `progress` is told the name of the stage."""
    theta, terms, made, still_open = descend(
        system_of(data, state, loss), state.theta, n_step, tolerance, lambda share: progress(name, share)
    )
    return replace(state, theta=theta, terms=terms, n_step=state.n_step + made, open=still_open)
