"""What the spectra of a scene have in common: their mean and the few directions in which they vary.

Reflectances lie near a subspace of low rank (EventSpecPS, section 4.2, shares K bases among all pixels). Here
it is a Gaussian prior with the covariance of probabilistic principal components (Tipping and Bishop 1999), learnt
from noisy pixels. Directions in which spectra vary visibly above the noise of single pixels make the rank.
"""

from dataclasses import dataclass

import drjit as dr
import numpy as np

from evsdr.solve.neighbours.priors import opaque_matrix
from evsdr.solve.neighbours.student import learn_scatter

KNOWN = 0.05  # largest standard deviation of a reflectance that teaches
FEWEST, MOST = 100, 4000  # pixels that teach
VISIBLE = (
    1.0  # smallest standard deviation of a direction that counts, relative to the noise of single pixels
)
SMALLEST = 1e-3  # standard deviation of a reflectance around the subspace, at least


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
    """

    mean: np.ndarray
    precision: np.ndarray
    rank: int

    def arrays(self, Float: type) -> "LearntSpectra":
        """Lay mean and precision out as arrays of width 1, which no kernel holds as numbers."""
        mean = [dr.opaque(Float, float(value)) for value in self.mean]
        return LearntSpectra(mean, opaque_matrix(Float, self.precision))


@dataclass(frozen=True)
class LearntSpectra:
    """`Spectra` as arrays of width 1: mean (n_band) and precision (n_band, n_band)."""

    mean: list
    precision: list


def learn_spectra(reflectance: np.ndarray, covariance: np.ndarray) -> Spectra | None:
    """Learn the distribution of spectra from noisy ones.

    Parameters
    ----------
    reflectance : (n_pixel, n_band) float
        Estimates.
    covariance : (n_pixel, n_band, n_band) float
        Of their noise.

    Returns
    -------
    Spectra or None
        None where too few pixels are known.
    """
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    known = np.flatnonzero(sigma.max(axis=1) < KNOWN)
    if len(known) < FEWEST:
        return None
    known = known[:: max(1, len(known) // MOST)]
    r, noise = reflectance[known], covariance[known]
    n_band = r.shape[1]
    mean, spread = learn_scatter(r, noise, SMALLEST**2 * np.eye(n_band), about_zero=False)
    variance, direction = np.linalg.eigh(spread)
    blur = np.median(np.einsum("ki,xkl,li->xi", direction, noise, direction), axis=0)
    rank = np.count_nonzero(variance > VISIBLE**2 * blur)
    return Spectra(mean, np.linalg.inv(spread), max(int(rank), 1))
