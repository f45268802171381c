"""How quantities scatter, learnt from noisy ones: the covariance of a multivariate Student's t.

Each measurement is z = s + n, where n is noise of known covariance N and s the quantity. Expectation maximisation
(Lange, Little and Taylor 1989, Robust statistical modeling using the t distribution; Tipping and Bishop 1999 for
known noise) estimates mean and covariance of s.
"""

import numpy as np

FREEDOM = 3.0  # of Student's t: the smaller, the less an outlier counts
N_EXPECTATION = 20


def learn_scatter(
    z: np.ndarray, noise: np.ndarray, floor: np.ndarray, about_zero: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate mean and covariance of quantities behind noisy measurements.

    Parameters
    ----------
    z : (n, d) float
        Measurements.
    noise : (n, d, d) float
        Covariance of the noise of each.
    floor : (d, d) float
        Smallest covariance, positive definite.
    about_zero : bool
        The mean is known to be 0.

    Returns
    -------
    mean : (d) float
    covariance : (d, d) float
    """
    d = z.shape[1]
    mean = np.zeros(d) if about_zero else np.median(z, axis=0)
    spread = np.diag(np.median((z - mean) ** 2, axis=0) / 0.455) + floor
    for _ in range(N_EXPECTATION):
        off = z - mean
        gain = np.linalg.solve(spread + noise, np.broadcast_to(spread, noise.shape))
        known = np.einsum("xji,xj->xi", gain, off)
        left = spread - spread @ gain.mean(axis=0)
        distance = np.einsum("xi,xi->x", off, known @ np.linalg.inv(spread))  # off' (spread + noise)^-1 off
        weight = (FREEDOM + d) / (FREEDOM + distance)
        if not about_zero:
            mean = mean + weight @ known / weight.sum()
        spread = np.einsum("x,xi,xj->ij", weight / len(z), known, known) + left
        spread = 0.5 * (spread + spread.T) + floor
    return mean, spread


def update_scatter(z: np.ndarray, left: np.ndarray, spread: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """Estimate the covariance of quantities about 0 from their posterior means and covariances.

    Parameters
    ----------
    z : (n, d) float
        Posterior means.
    left : (n, d, d) float
        Posterior covariances.
    spread : (d, d) float
        Covariance so far.
    floor : (d, d) float
        Smallest covariance.
    """
    d, second = z.shape[1], z[:, :, None] * z[:, None, :] + left
    for _ in range(3):
        distance = np.einsum("xij,ij->x", second, np.linalg.inv(spread))
        weight = (FREEDOM + d) / (FREEDOM + distance)
        spread = np.einsum("x,xij->ij", weight / len(z), second) + floor
    return 0.5 * (spread + spread.T)
