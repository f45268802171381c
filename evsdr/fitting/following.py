"""Photoreceptors that lag and the maps, in turns: what they show follows from the light that was fitted.

Pairs hold what they show of the maps before, and how that answers to other light to first order, so that a few turns do.
"""

from dataclasses import replace

import numpy as np

from evsdr.effects.blocks import sample_of
from evsdr.effects.world import Fitted, World
from evsdr.fitting.decoder import Decoder
from evsdr.progress import Progress
from evsdr.solve.background import relative_residuals
from evsdr.solve.problem import lay_out

# Of a residual's standard deviation, by which it may still move, root mean square; guessed. Measured before an EVK4 after each fit: a
# blob of 256 x 256 in slots of 20 ms 0.07, 0.008, its error the same; a sphere of 32 x 32 in slots of 2 ms 0.15, 0.05, 0.26 -> 0.20 degrees
STILL = 0.1
UNSETTLED = 0.3  # the same, from which it is worth a word, and another fit where effects are not looked for thoroughly; guessed
# Of what residuals moved by before: from there on turns gain nothing, as a few pixels in wrong minima go to and fro for ever. Measured
# on a skull and a lion of 96 x 96, whose shadows follow the fit: eight turns have 2.26 and 3.96 degrees, three 2.14 and 4.06; on a
# sphere in slots of 0.5 ms: six 1.33, RMSE 0.070, four 1.29 and 0.061
AS_BEFORE = 0.9
MOST_TURNS = 8  # guessed: slots of 2 ms take one, of 0.5 ms four
N_SHOWN = 2000  # pixels that show it; guessed
MOST = 3.0  # standard deviations by which one residual may have moved; guessed


def follow(world: World, fitted: Fitted, solve: Decoder, progress: Progress) -> Fitted:
    """Fit again until photoreceptors show no other light under the maps found than under those before, or residuals move as before."""
    still, before = STILL if world.terms.thorough else UNSETTLED, np.inf
    for turn in range(MOST_TURNS):
        moved = moves(world, fitted)
        ended = moved < still or moved > AS_BEFORE * before
        if ended or progress("light that photoreceptors show", turn / MOST_TURNS):
            break
        before = moved
        fitted = solve(world.problem(fitted), fitted, "again", progress)
    return fitted


def moves(world: World, fitted: Fitted) -> float:
    """Say by how many of their standard deviations residuals move, root mean square, once photoreceptors follow a fit.

    0 without a lag.
    """
    if not world.lag:
        return 0.0
    some = sample_of(fitted, N_SHOWN)
    problem, mask = some.problem, some.problem.grid.mask
    u = []
    for pairs in (problem.told, replace(world, mask=mask).pairs(some)):
        laid_out = lay_out(world.recording, pairs, mask, problem.illumination)
        u.append(relative_residuals(replace(problem, pairs=laid_out), some.solution))
    moved = np.abs(u[1] - u[0]) / fitted.solution.noise
    return float(np.sqrt(np.mean(np.square(np.minimum(moved, MOST))))) if len(moved) else 0.0
