"""What the model's own errors leave open of the maps, from what the events show of them."""

from dataclasses import replace

import numpy as np

from evsdr.effects.gloss import lobe_error
from evsdr.effects.world import Fitted, World
from evsdr.fitting.decoder import Decoder
from evsdr.fitting.misfit import Misfit, in_common
from evsdr.records import Signals
from evsdr.solve.discrepancy import common_share, excess_share, noise_of
from evsdr.solve.noise import IGNORED

# What residuals of a pixel are larger than those of most counts so many times more for its maps: they have taken up some of what
# the model lacks, and it goes together from LED to LED. Measured by hand, on maps of `experiments.draws` (15 of 0 to 24 and 900 to 913): with
# this and `maps.RIM_TURN` 14 keep the promise for normals, with 2 12, without both 4; sigmas are 24 % larger. Likewise of 24, for reflectance with
# `log_spread`: without 14, with this 16. 0 to 27 as they come: see its README
MISFIT = 3.0


def with_model_error(
    world: World, fitted: Fitted, matt: Fitted, solve: Decoder
) -> tuple[Fitted, Signals, Misfit]:
    """Let sigmas count what residuals of neighbours have in common or show beyond noise, what lobes of another
    form leave, what other visibility would make of maps, the twins of normals of metal, and what the pixel's own residuals
    are larger than those of most.

    Parameters
    ----------
    world : World
        What is believed.
    fitted, matt : Fitted
        The fit, and the one before lobes were put in.
    solve : Decoder
        What solves under it.

    Returns
    -------
    fitted : Fitted
    signals : Signals
        See `Decoder.signals`.
    misfit : Misfit
        Where the fit explains the events less well than elsewhere, and what neighbours have in common.
    """
    signals, problem, solution = solve.signals(fitted), fitted.problem, fitted.solution
    share, common = common_share(signals, problem.grid.mask, fitted.maps.mask)
    misfit = solve.misfit(fitted)
    misfit = replace(misfit, words=f"{misfit.words}; {in_common(common)}")
    if solve.settings.solver == "adam":  # its maps stand as they are
        return fitted, signals, replace(misfit, least=0.0)
    share = np.maximum(share, excess_share(signals, problem.grid.mask))
    error = share[:, None, None] * noise_of(solve.alone(fitted))
    if world.shadows == "latent":
        error += world.left_open(matt)
    if world.metal is not None:
        error += solve.twins(fitted)
    if world.gloss is not None or world.rough is not None:
        error += lobe_error(solution.theta - matt.solution.theta)
    error += of_misfit(solution.noise_factor)[:, None, None] * (solution.covariance + error)
    return solve.fitted(problem, replace(solution, model_error=error.astype(np.float32))), signals, misfit


def of_misfit(factor: np.ndarray) -> np.ndarray:
    """Give the share (n_pixel,) of what noise makes of a pixel's maps that its misfit makes beside it.

    Parameters
    ----------
    factor : (n_pixel,) float
        See `Solution.noise_factor`; of pixels whose events count for nothing, there is none.
    """
    square = np.square(np.where(factor < IGNORED, factor, 1.0).astype(float))
    return MISFIT * (1 - 1 / square)
