"""How much residuals scatter: in most pixels, and how much more in some.

Noise of events is independent from one to the next; what the model leaves out comes again in each round, whenever the
same LEDs are lit. So residuals of a pixel that go together in a slot tell of misfit, and the events of a slot then count
as fewer than they are: the covariance of a score that is summed by clusters (Liang and Zeger 1986), one factor per pixel.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import drjit as dr
import numpy as np

from evsdr.frozen import recorded
from evsdr.model.arrays import owned
from evsdr.solve.law import variance_of
from evsdr.solve.loss import Loss, relative_residual, scaled, system_table
from evsdr.solve.pair_data import PairData, ends, unpack_pair
from evsdr.solve.solution import Data, State
from evsdr.solve.system import system_of
from evsdr.solve.tuning import Tuning

NOISE_RANGE = (0.005, 1.0)  # of the relative residual
UNTOLD = 0.1  # the same, where no pixel tells; guessed: an EVK4's have 0.05 and more
MISFIT = 0.5  # of that of most pixels, above which events and model contradict each other; guessed
N_SHOWN = 32  # pairs of a pixel that show its noise
N_SLOTTED = 128  # pairs of a pixel that show whether those of a slot go together
SMALLEST_SQUARE = 1e-12  # of a score, or a residual
FEW_SLOTS = 8  # as many slots as count for what is true of most pixels; guessed
MOST_FREEDOM = 2.0  # largest factor for the unknowns that pairs have been fitted with
MEDIAN_TO_SIGMA = 1.4826  # of |x| for Gaussian x
MOST = 10.0  # times the noise of most pixels
IGNORED = 100.0  # noise factor of pixels whose events contradict the model


def weighted_median(value: np.ndarray, weight: np.ndarray) -> float:
    """Give the value (n,) below which half of the weights (n,) lie."""
    order = np.argsort(value)
    below = np.cumsum(weight[order])
    return float(value[order[np.searchsorted(below, 0.5 * below[-1])]])


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
    n_unknown : int
        Of each pixel.
    """

    pixel: np.ndarray
    count: np.ndarray
    value: np.ndarray
    n_unknown: int = 0

    def of_most(self) -> float:
        """Give that of most pixels: hot ones fire most events, but are few. Those that have no more events than unknowns, which explain all, do not tell."""
        tells = np.clip(self.count - self.n_unknown, 0, N_SHOWN)
        if len(self.pixel) == 0:
            return NOISE_RANGE[1]
        if not tells.any():
            return UNTOLD
        return float(np.clip(weighted_median(self.value, tells), *NOISE_RANGE))


@recorded
def _residuals(system, theta: list, pixel, shown):
    """u of some pairs, each of the pixel told; phases of start and end, polarity, and light at the end."""
    table = system_table(system, theta)
    told = scaled(system.pairs, system.unknowns.gains(theta))
    dr.eval(told.threshold_on, told.threshold_off)
    u = relative_residual(table, told, system.constant_light, shown, pixel, True)[0]
    light = ends(table, system.pairs, shown, pixel, True)[1] + system.constant_light
    return u, *unpack_pair(system.pairs.phases, shown, True), light


def scatter_of(data: Data, state: State) -> Scatter:
    """Measure the scatter of each pixel's residuals, by some."""
    pairs: PairData = state.pairs
    UInt32 = type(pairs.first)
    count = pairs.counts
    pixel = np.flatnonzero(count)
    if len(pixel) == 0:
        return Scatter(pixel, count[pixel], np.empty(0))
    n, first = count[pixel], pairs.first.numpy().astype(np.int64)[pixel]
    shown = first[:, None] + n[:, None] * np.arange(N_SHOWN) // N_SHOWN
    of_pixel = owned(UInt32, np.repeat(pixel, N_SHOWN))
    system = system_of(data, state, Loss(data.robust))
    u = _residuals(system, state.theta, of_pixel, owned(UInt32, shown.ravel()))[0].numpy()
    freedom = np.minimum(np.sqrt(n / np.maximum(n - len(state.theta), 1)), MOST_FREEDOM)
    variance = variance_of(u.reshape(shown.shape), data.robust, least=SMALLEST_SQUARE)
    return Scatter(pixel, n, np.sqrt(variance) * freedom, len(state.theta))


@dataclass(frozen=True)
class Slotted:
    """Some pairs of some pixels, and how their residuals go together with those of the same slot and polarity.

    Attributes
    ----------
    pixel, group : (n,) int
        Pixel of each pair, and which of the pixel's slots and polarities it is of.
    score : (n,) float
        Its residual, by robust weights.
    start, end : (n,) float
        Phases.
    light : (n,) float
        At its end, with the constant light.
    shape : tuple of 2 int
        Number of pixels, and of groups of each.
    """

    pixel: np.ndarray
    group: np.ndarray
    score: np.ndarray
    start: np.ndarray
    end: np.ndarray
    light: np.ndarray
    shape: tuple[int, int]

    @cached_property
    def number(self) -> np.ndarray:
        """Count the pairs of each group (n_pixel, n_own)."""
        return self._of_groups()

    @cached_property
    def total(self) -> np.ndarray:
        """Sum the scores of each group (n_pixel, n_own)."""
        return self._of_groups(self.score)

    @cached_property
    def own(self) -> np.ndarray:
        """Number the group (n,) of each pair from its pixel's first.

        Readings that are tried side by side have their slots behind each other's; no pixel has all of them.
        """
        first = np.full(self.shape[0], self.shape[1])
        np.minimum.at(first, self.pixel, self.group)
        return self.group - first[self.pixel]

    def _of_groups(self, weight: np.ndarray | None = None) -> np.ndarray:
        n_pixel, n_own = self.shape[0], int(self.own.max(initial=-1)) + 1
        return np.bincount(n_own * self.pixel + self.own, weight, n_pixel * n_own).reshape(n_pixel, n_own)

    @property
    def n_group(self) -> np.ndarray:
        """Give how many groups of each pixel (n_pixel,) have pairs."""
        return np.count_nonzero(self.number, axis=1)

    @property
    def shared(self) -> np.ndarray:
        """Give the product (n,) of each score with the mean of the others of its group; nan where it is alone.

        Its mean is 0 for noise of single events, and else the variance of what the model leaves out.
        """
        others = self.number[self.pixel, self.own] - 1
        mean = (self.total[self.pixel, self.own] - self.score) / np.maximum(others, 1)
        return np.where(others > 0, self.score * mean, np.nan)


def slotted(data: Data, state: State, most: int | None = None) -> Slotted:
    """Look at some pairs of each pixel, or of at most so many."""
    pairs: PairData = state.pairs
    UInt32, n_group = type(pairs.first), 2 * dr.width(pairs.slot_leds)
    count, first = pairs.counts, pairs.first.numpy().astype(np.int64)
    some = np.minimum(count, N_SLOTTED)
    if most is not None:
        some[np.arange(len(some)) % max(-(-len(some) // most), 1) > 0] = 0
    pixel = np.repeat(np.arange(len(count)), some)
    within = np.arange(len(pixel)) - np.repeat(np.cumsum(some) - some, some)
    shown = first[pixel] + within * count[pixel] // some[pixel]
    if len(pixel) == 0:
        return Slotted(pixel, pixel, *np.zeros((4, 0)), (len(count), n_group))
    system = system_of(data, state, Loss(data.robust))
    found = _residuals(system, state.theta, owned(UInt32, pixel), owned(UInt32, shown))
    u, start, end, polarity, light = (value.numpy() for value in found)
    score = u / (1 + np.square(u / (data.robust * state.noise)))
    group = 2 * end.astype(np.int64) + (polarity > 0)
    return Slotted(pixel, group, score, start, end, light, (len(count), n_group))


def slot_factors(pairs: Slotted) -> np.ndarray:
    """Say by which factor (n_pixel,) float32 residuals that go together in slots raise a pixel's noise above that of most.

    It is at least 1, and shrunk toward that where few slots have events.
    """
    n_group = pairs.n_group
    together = np.sum(np.square(pairs.total) / np.maximum(pairs.number, 1), axis=1)
    some = n_group > 0
    most = max(np.median(together[some] / n_group[some]), SMALLEST_SQUARE) if some.any() else 1.0
    ratio = (FEW_SLOTS + together / most) / (FEW_SLOTS + n_group)
    return np.sqrt(np.maximum(ratio, 1)).astype(np.float32)


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
