"""What the spectra of a scene have in common: their mean and the few directions in which they vary.

Reflectances lie near a subspace of low rank (EventSpecPS, section 4.2, shares K bases among all pixels). Here
it is a Gaussian prior with the covariance of probabilistic principal components (Tipping and Bishop 1999), learnt
from noisy pixels; the Bayesian information criterion chooses the rank.
"""

from dataclasses import dataclass

import numpy as np

from evsdr.scatter import FREEDOM, learn_scatter

KNOWN = 0.05  # largest standard deviation of a reflectance that teaches
FEWEST, MOST = 100, 4000  # pixels that teach
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
    value, vector = np.linalg.eigh(spread)
    value, vector = value[::-1], vector[:, ::-1]
    best = None
    for rank in range(1, n_band + 1):
        kept = value.copy()
        kept[rank:] = np.mean(value[rank:]) if rank < n_band else 0
        model = (vector * kept) @ vector.T
        n_parameter = n_band + rank * n_band - rank * (rank - 1) / 2 + 1
        score = _log_evidence(r - mean, model + noise) - 0.5 * n_parameter * np.log(len(r))
        if best is None or score > best[0]:
            best = score, rank, model
    return Spectra(mean, np.linalg.inv(best[2]), best[1])


def _log_evidence(off: np.ndarray, total: np.ndarray) -> float:
    """Log probability of deviations under Student's t, each with its own covariance."""
    distance = np.einsum("xi,xi->x", off, np.linalg.solve(total, off[..., None])[..., 0])
    _, log_determinant = np.linalg.slogdet(total)
    tail = 0.5 * (FREEDOM + off.shape[1]) * np.log1p(distance / FREEDOM)
    return float(-np.sum(tail + 0.5 * log_determinant))
