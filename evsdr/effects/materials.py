"""Kinds of material, told apart by their spectra."""

import warnings

import numpy as np

MAX_KIND = 4  # of material
TOO_FEW = 2.0  # scatter of too few kinds, relative to that of MAX_KIND
MOST = 0.9  # share of pixels that a scatter speaks of
SAME_SPECTRUM = 0.05  # scatter of unit spectra that one material may have


def sort_materials(reflectance: np.ndarray, seed: int = 0) -> np.ndarray:
    """Sort pixels into 1..4 kinds by the shape of their spectra.

    The fewest kinds whose scatter is small in most pixels, or at most twice that of four kinds: four kinds of
    one material only share out its noise.

    Parameters
    ----------
    reflectance : (n_pixel, n_band) float

    Returns
    -------
    (n_pixel,) int
        Kinds from 0.
    """
    from scipy.cluster.vq import kmeans2  # late: few scenes are glossy

    spectrum = reflectance / np.maximum(np.linalg.norm(reflectance, axis=1, keepdims=True), 1e-9)
    labels, scatters = [], []
    for k in range(1, MAX_KIND + 1):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty kind is no harm
            centre, label = kmeans2(spectrum, k, minit="++", seed=seed, iter=30)
        labels.append(np.unique(label, return_inverse=True)[1])
        scatters.append(np.quantile(np.sum((spectrum - centre[label]) ** 2, axis=1), MOST))
        if scatters[-1] <= SAME_SPECTRUM**2:
            return labels[-1]
    return next(label for label, s in zip(labels, scatters) if s <= TOO_FEW * scatters[-1])
