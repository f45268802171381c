"""How much residuals scatter: in most pixels, and how much more in some."""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.frozen import recorded
from evsdr.model.arrays import owned
from evsdr.solve.loss import Loss, relative_residual, scaled, system_table
from evsdr.solve.pair_data import PairData
from evsdr.solve.solution import Data, State
from evsdr.solve.system import system_of
from evsdr.solve.tuning import Tuning

NOISE_RANGE = (0.005, 1.0)  # of the relative residual
MISFIT = 0.5  # of that of most pixels, above which events and model contradict each other; guessed
N_SHOWN = 32  # pairs of a pixel that show its noise
MOST_FREEDOM = 2.0  # largest factor for the unknowns that pairs have been fitted with
MEDIAN_TO_SIGMA = 1.4826  # of |x| for Gaussian x
MOST = 10.0  # times the noise of most pixels
IGNORED = 100.0  # noise factor of pixels whose events contradict the model


@dataclass(frozen=True)
class Scatter:
    """Standard deviation of u in the pixels that have pairs.

    Attributes
    ----------
    pixel : (n,) int
        These.
    count : (n,) int
        Their pairs.
    value : (n,) float
    """

    pixel: np.ndarray
    count: np.ndarray
    value: np.ndarray

    def of_most(self) -> float:
        """Give that of most pixels: hot ones fire most events, but are few."""
        return float(np.clip(np.median(self.value), *NOISE_RANGE)) if len(self.pixel) else NOISE_RANGE[1]


@recorded
def _residuals(system, theta: list, pixel, shown):
    """|u| of some pairs, each of the pixel told."""
    table = system_table(system, theta)
    told = scaled(system.pairs, system.unknowns.gains(theta))
    dr.eval(told.threshold_on, told.threshold_off)
    return dr.abs(relative_residual(table, told, system.constant_light, shown, pixel, True)[0])


def scatter_of(data: Data, state: State) -> Scatter:
    """Measure the scatter of each pixel's residuals, by the median of some."""
    pairs: PairData = state.pairs
    UInt32 = type(pairs.offset)
    count = pairs.counts
    pixel = np.flatnonzero(count)
    if len(pixel) == 0:
        return Scatter(pixel, count[pixel], np.empty(0))
    n, first = count[pixel], pairs.offset.numpy().astype(np.int64)[pixel]
    shown = first[:, None] + n[:, None] * np.arange(N_SHOWN) // N_SHOWN
    of_pixel = owned(UInt32, np.repeat(pixel, N_SHOWN))
    system = system_of(data, state, Loss(data.robust))
    u = _residuals(system, state.theta, of_pixel, owned(UInt32, shown.ravel())).numpy().reshape(shown.shape)
    freedom = np.minimum(np.sqrt(n / np.maximum(n - len(state.theta), 1)), MOST_FREEDOM)
    return Scatter(pixel, n, MEDIAN_TO_SIGMA * np.median(u, axis=1) * freedom)


def measured(data: Data, state: State) -> State:
    """Measure the noise of most pixels."""
    return replace(state, noise=scatter_of(data, state).of_most())


def noise_factors(
    scatter: Scatter, noise: float, n_pixel: int, n_unknown: int, misfit: float = Tuning.misfit
) -> np.ndarray:
    """Say how much noisier each pixel is than most, at least 1; what its own few pairs say is shrunk toward 1.

    From `misfit` on, with more pairs than unknowns, it is `IGNORED`.
    """
    own = np.minimum(scatter.value / noise, MOST)
    weight = np.minimum(scatter.count, N_SHOWN)
    factor = np.ones(n_pixel, np.float32)
    factor[scatter.pixel] = np.maximum((N_SHOWN + weight * own) / (N_SHOWN + weight), 1)
    factor[scatter.pixel[(own > misfit) & (scatter.count > n_unknown)]] = IGNORED
    return factor
