"""Whether errors are as large as sigmas say.

The sigma of a normal is the root mean square of the angle by which it may be off (`maps.normal_sigma_deg`): that of an
error across the true normal, in two dimensions. If it is the same in both, z = angle / sigma has the distribution
1 - exp(-z^2), so that 63, 98 and 99.99 % lie within one, two and three sigma; an error along one line only is
Gaussian, 68, 95 and 99.7 %. The first is taken: most normals are known about alike in both. Reflectance has
z = error / sigma, Gaussian. Of both the mean square is 1.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

LEVELS = np.arange(1, 4)  # standard deviations
PROMISED = np.array([0.60, 0.90, 0.97])  # shares of the known pixels within them, at least
STRIDE = 4  # pixels between those that are counted: neighbours share their priors' errors
EDGES = np.array([0.2, 0.4, 0.6, 0.8, 0.95])  # quantiles between the bins
LEVEL = 0.01  # at which one of all cases may be refused by chance
FAR = 5.0  # standard deviations beyond which an error is a blunder


def rank_of_angle(z: np.ndarray) -> np.ndarray:
    """Give the quantile 0..1 of angle / sigma."""
    return -np.expm1(-np.square(z))


def rank_of_value(z: np.ndarray) -> np.ndarray:
    """Give the quantile 0..1 of |error| / sigma."""
    return stats.chi2.cdf(np.square(z), 1)


def thinned(mask: np.ndarray, seed: int) -> np.ndarray:
    """Keep a pixel in `STRIDE` along both axes of a mask (H, W), others for each seed."""
    keep = np.zeros_like(mask)
    row, column = np.random.default_rng([seed, 3]).integers(STRIDE, size=2)
    keep[row::STRIDE, column::STRIDE] = True
    return mask & keep


@dataclass(frozen=True)
class Verdict:
    """A test of ranks.

    Attributes
    ----------
    p : float
        Probability of a worse one if sigmas are true; 1 where nothing is known.
    effect : float
        By which counts of one recording vary more than those of independent pixels.
    """

    p: float
    effect: float


def uniformity(ranks: list[np.ndarray]) -> Verdict:
    """Test ranks of some recordings (n,) for a uniform distribution, by a binned chi-square (Pearson 1900).

    Pixels of a recording share its errors. What thinning leaves of that shows in the scatter of the bins' shares between
    recordings; chi-square is divided by it (Rao and Scott 1981, first order).
    """
    ranks = [rank for rank in ranks if len(rank)]
    if not ranks:
        return Verdict(1.0, 1.0)
    expected = np.diff(np.concatenate([[0], EDGES, [1]]))
    counts = np.array([np.bincount(np.searchsorted(EDGES, rank), minlength=len(expected)) for rank in ranks])
    number = counts.sum(axis=1)
    share = counts.sum(axis=0) / number.sum()
    effect = 1.0
    if len(ranks) > 1:
        mean = (number[:, None] * share)[:, share > 0]
        away = np.sum((counts[:, share > 0] - mean) ** 2 / mean)
        effect = max(away / (len(ranks) - 1) / max(mean.shape[1] - 1, 1), 1.0)
    chi_square = np.sum((counts.sum(axis=0) - number.sum() * expected) ** 2 / (number.sum() * expected))
    return Verdict(float(stats.chi2.sf(chi_square / effect, len(expected) - 1)), float(effect))


def level_of_each(n: int) -> float:
    """Give the level of each of n tests that all together have `LEVEL` (Sidak 1967)."""
    return 1 - (1 - LEVEL) ** (1 / n)


def shares_within(z: np.ndarray) -> np.ndarray:
    """Give the shares (3,) of z (n,) within `LEVELS`."""
    return np.mean(np.abs(z) <= LEVELS[:, None], axis=1) if len(z) else np.full(len(LEVELS), np.nan)


def keeps_promise(within: np.ndarray) -> bool:
    """Tell whether shares are as large as promised."""
    return bool(np.all(within >= PROMISED))
