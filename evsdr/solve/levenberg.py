"""Levenberg-Marquardt on all pixels at once: each has its own damping and accepts or rejects its own step.

The functions are recorded once and then run for any number of pixels (`dr.freeze`); whatever changes from recording
to recording is an argument, and an array. The forward model is a callable; nothing here knows Mitsuba.
"""

from collections.abc import Callable
from dataclasses import replace

import drjit as dr

from evsdr.frozen import recorded
from evsdr.model.illumination import pixel_horizon
from evsdr.progress import Progress, silent
from evsdr.solve import triangles
from evsdr.solve.loss import Loss, pixel_terms
from evsdr.solve.solution import Data, State
from evsdr.solve.system import PixelSystem, system_of

FIRST_DAMPING = 1e-2
DAMPING_RANGE = (1e-6, 1e6)
SHRINK, GROW = 0.25, 6.0  # of the damping after a step that was accepted, or rejected
OPEN_SHARE = 0.005  # of the pixels: when fewer still gain, the others are not worth a step of all


@recorded
def evaluate(system: PixelSystem, theta: list) -> list:
    """Give cost, gradient and lower triangle of the Gauss-Newton matrix, weak prior included."""
    return _terms(system, theta)


def _terms(system: PixelSystem, theta: list) -> list:
    cost, gradient, matrix = pixel_terms(system, theta)
    more = system.unknowns.prior(theta, system.spread, system.weak)
    return [cost + more[0], *(a + b for a, b in zip(gradient, more[1])), *triangles.added(matrix, more[2])]


@recorded
def step(system: PixelSystem, theta: list, terms: list, damping, tolerance):
    """Make one step; each pixel keeps what lowers its own cost.

    Returns
    -------
    theta, terms, damping
        Anew.
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
    gaining = dr.sum(dr.select(fallen > tolerance, Float(1.0), 0.0))
    theta = [dr.select(better, new, old) for new, old in zip(trial, theta)]
    terms = [dr.select(better, new, old) for new, old in zip(new_terms, terms)]
    damping = dr.clip(damping * dr.select(better, SHRINK, GROW), *DAMPING_RANGE)
    return theta, terms, damping, gaining


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
    terms = evaluate(system, theta)
    damping = dr.zeros(Float, n_pixel) + dr.opaque(Float, FIRST_DAMPING)
    enough = dr.opaque(Float, tolerance)
    dr.eval(damping)
    made, still_open = 0, 0.0
    while made < n_step:
        theta, terms, damping, gaining = step(system, theta, terms, damping, enough)
        made, still_open = made + 1, float(gaining[0]) / n_pixel  # waits, so that Ctrl-C is heard
        if progress(made / n_step) or still_open < OPEN_SHARE:
            break
    return theta, terms, made, still_open


def descended(
    data: Data, state: State, loss: Loss, n_step: int, tolerance: float, name: str, progress: Progress
) -> State:
    """Descend from a state on the pairs that it hears; `progress` is told the name of the stage."""
    theta, terms, made, still_open = descend(
        system_of(data, state, loss), state.theta, n_step, tolerance, lambda share: progress(name, share)
    )
    return replace(state, theta=theta, terms=terms, n_step=state.n_step + made, open=still_open)
