"""What the spectra of a scene have in common: their mean and the few directions in which they vary.

Reflectances lie near a subspace of low rank (EventSpecPS, section 4.2, shares K bases among all pixels). Here
it is a Gaussian prior with the covariance of probabilistic principal components (Tipping and Bishop 1999), learnt
from noisy pixels. Directions in which spectra vary visibly above the noise of single pixels make the rank.

Pixels of one surface are one draw of its colour, not as many as they are: what neighbours tell of a pixel's colour
does not count as its own (`own_share`).
"""

from dataclasses import dataclass

import drjit as dr
import numpy as np

from evsdr.solve.neighbours.priors import opaque_matrix
from evsdr.solve.neighbours.student import FREEDOM, learn_scatter

KNOWN = 0.05  # largest standard deviation of a reflectance that teaches
FEWEST, MOST = 100, 4000  # pixels that teach
VISIBLE = (
    1.0  # smallest standard deviation of a direction that counts, relative to the noise of single pixels
)
SMALLEST = 1e-3  # standard deviation of a reflectance around the subspace, at least
TINY = 1e-30


@dataclass(frozen=True)
class Spectra:
    """Distribution of the reflectances of a scene.

    Attributes
    ----------
    mean : (n_band) float
    precision : (n_band, n_band) float
        Inverse of the covariance.
    rank : int
        Number of its directions.
    share : float
        Of a draw that each pixel is, 0 to 1.
    """

    mean: np.ndarray
    precision: np.ndarray
    rank: int
    share: float

    def arrays(self, Float: type) -> "LearntSpectra":
        """Lay mean and precision out as arrays of width 1, which no kernel holds as numbers."""
        mean = [dr.opaque(Float, float(value)) for value in self.mean]
        return LearntSpectra(mean, opaque_matrix(Float, self.precision), dr.opaque(Float, self.share))


@dataclass(frozen=True)
class LearntSpectra:
    """`Spectra` as arrays of width 1: mean (n_band), precision (n_band, n_band) and share."""

    mean: list
    precision: list
    share: object


def learn_spectra(reflectance: np.ndarray, covariance: np.ndarray, beside: np.ndarray) -> Spectra | None:
    """Learn the distribution of spectra from noisy ones.

    Parameters
    ----------
    reflectance : (n_pixel, n_band) float
        Estimates.
    covariance : (n_pixel, n_band, n_band) float
        Of their noise.
    beside : (n_pixel, n_band) float
        Estimates of the pixels beside them, NaN where there is none; without any, each pixel is a draw of its own.

    Returns
    -------
    Spectra or None
        None where too few pixels are known.
    """
    known = np.flatnonzero(is_known(covariance))
    if len(known) < FEWEST:
        return None
    known = known[:: max(1, len(known) // MOST)]
    r, noise = reflectance[known], covariance[known]
    n_band = r.shape[1]
    mean, spread = learn_scatter(r, noise, SMALLEST**2 * np.eye(n_band), about_zero=False)
    variance, direction = np.linalg.eigh(spread)
    blur = np.median(np.einsum("ki,xkl,li->xi", direction, noise, direction), axis=0)
    rank = np.count_nonzero(variance > VISIBLE**2 * blur)
    share = own_share(r, beside[known], mean, np.linalg.inv(spread + np.median(noise, axis=0)))
    return Spectra(mean, np.linalg.inv(spread), max(int(rank), 1), share)


def is_known(covariance: np.ndarray) -> np.ndarray:
    """Tell which reflectances teach, from the covariances of their noise."""
    return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).max(axis=1) < KNOWN


def own_share(r: np.ndarray, beside: np.ndarray, mean: np.ndarray, precision: np.ndarray) -> float:
    """Say how much of a pixel's colour all others do not tell, 0 to 1.

    Of colours that deviate from the mean as a separable Markov field with the correlation c between neighbours, what is left of
    a pixel's variance once the others are known is ((1 - c^2) / (1 + c^2))^2 (derived: one factor for each axis).

    Parameters
    ----------
    r, beside : (n, n_band) float
        Reflectances of pixels and of those beside them; a pixel with NaN beside it tells nothing.
    mean, precision : (n_band) and (n_band, n_band) float
        Of noisy spectra.
    """
    both = np.isfinite(beside).all(axis=1)
    off, other = (nearest_multiple(some[both], mean, precision) - mean for some in (r, beside))
    own = 0.5 * sum(np.einsum("xi,ij,xj->x", a, precision, a) for a in (off, other))
    weight = 1 / (FREEDOM + own)
    together = weight @ np.einsum("xi,ij,xj->x", off, precision, other)
    correlation = min(max(together / max(weight @ own, TINY), 0.0), 1.0)
    return float(((1 - correlation**2) / (1 + correlation**2)) ** 2)


def nearest_multiple(r: np.ndarray, mean: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Give the multiples of spectra (n, n_band) that are nearest to the mean."""
    along = r @ precision
    return r * (along @ mean / np.maximum(np.sum(along * r, axis=1), TINY))[:, None]
