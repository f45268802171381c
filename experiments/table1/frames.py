"""Frame-based baselines, written from their papers: one shot of all bands, each band lit from its own side.

A band's frame is m_b = R_b max(0, l_b . n), so a pixel has as many equations as bands, and spectra must lie in a
known space of few dimensions.
"""

import numpy as np
from evsdr.scenes.make_surfaces import WAVELENGTH_NM, basis_spectra

from .cases import BAND_NM

RANK = 3  # of the known space of spectra
DARK = 0.005  # of a white patch: below, a band counts as shadowed
TILTS = 6  # start normals beside the frontal one
STEPS = 60  # of the bilinear fit
SMALLEST = 1e-3  # reflectance


def training_spectra() -> np.ndarray:
    """Give spectra (n, n_band) to learn a space from: those of the repository's painted surfaces, and their mixtures."""
    pure = np.array([np.interp(BAND_NM, WAVELENGTH_NM, s) for n in (1, 3, 8) for s in basis_spectra(n)])
    i, j = np.triu_indices(len(pure))
    return 0.5 * (pure[i] + pure[j])


def space(spectra: np.ndarray, rank: int = RANK) -> np.ndarray:
    """Give the `rank` directions (n_band, rank) that hold most of the spectra."""
    return np.linalg.svd(spectra, full_matrices=False)[2][:rank].T


def solve_multiplexed(
    image: np.ndarray, light: np.ndarray, spectra: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve for normals and spectra as Fyffe, Yu and Debevec 2011 ("Single-shot photometric stereo by spectral multiplexing").

    R = B c in the space of known spectra makes each band bilinear, m_b = (B_b . c)(l_b . n). Both factors are fitted in
    turn from several start normals; the best fit of each pixel counts. Shadowed bands are left out.

    Parameters
    ----------
    image : (n_pixel, n_band) float
        A shot.
    light : (n_band, 3) float
        Unit vectors to the light of each band.
    spectra : (n, n_band) float
        That span the space.

    Returns
    -------
    normal : (n_pixel, 3) float
    reflectance : (n_pixel, n_band) float
    """
    basis, weight = space(spectra), (image > DARK).astype(float)
    best, found = np.full(len(image), np.inf), np.zeros((len(image), 3 + basis.shape[1]))
    azimuth = 2 * np.pi * np.arange(TILTS) / TILTS
    starts = [
        (0.0, 0.0, 1.0),
        *np.column_stack([np.cos(azimuth), np.sin(azimuth), np.ones(TILTS)]) / np.sqrt(2),
    ]
    for start in starts:
        normal = np.tile(start, (len(image), 1))
        for _ in range(STEPS):
            colour = _least_squares((normal @ light.T)[..., None] * basis, image, weight)
            normal = _least_squares((colour @ basis.T)[..., None] * light, image, weight)
        cost = (weight * ((colour @ basis.T) * (normal @ light.T) - image) ** 2).sum(axis=1)
        better = cost < best
        best[better], found[better] = cost[better], np.hstack([normal, colour])[better]
    return _finish(found[:, :3], found[:, 3:] @ basis.T)


def solve_reciprocal(
    image: np.ndarray, light: np.ndarray, spectra: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve for normals and spectra that vary from pixel to pixel as Guo et al. 2022, in closed form.

    With the reciprocal reflectance in a known space, 1 / R = Q c, each band is linear: m_b Q_b . c - l_b . n = 0. Each
    pixel's (c, n) is the null vector of its equations. Arguments as those of `solve_multiplexed`.
    """
    basis, lit = space(1 / np.maximum(spectra, SMALLEST)), image > DARK
    rows = np.concatenate([image[..., None] * basis, np.broadcast_to(-light, (*image.shape, 3))], axis=-1)
    rows = np.where(lit[..., None], rows, 0.0)
    scale = np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)
    null = np.linalg.svd(rows / scale, full_matrices=False)[2][:, -1] / scale[:, 0]
    reciprocal, normal = null[:, : basis.shape[1]] @ basis.T, null[:, basis.shape[1] :]
    sign = np.where(normal[:, 2:] < 0, -1.0, 1.0)
    return _finish(sign * normal, 1 / np.maximum(sign * reciprocal, 1e-6))


def solve_one_chromaticity(image: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve for normals and spectra that differ by a factor alone as Guo et al. 2022, in closed form.

    All pixels share q_b = 1 / r_b; each one's m_b q_b is a linear function of the light, so what is left of it outside
    of the space of light vectors is 0: q is the null vector of (P o M^T M), P the projector on the rest.
    """
    lit = image[(image > DARK).all(axis=1)]
    rest = np.eye(len(light)) - light @ np.linalg.pinv(light)
    q = np.linalg.eigh(rest * (lit.T @ lit))[1][:, 0]
    q *= np.sign(q.sum())
    weight = (image > DARK).astype(float)
    normal = _least_squares(np.broadcast_to(light, (*image.shape, 3)), image * q, weight)
    return _finish(normal, np.broadcast_to(1 / np.where(np.abs(q) > 1e-6, q, 1e-6), image.shape))


def _least_squares(rows: np.ndarray, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Solve small systems (n_pixel, n_equation, n_unknown), held where they are short of equations."""
    weighted = rows * weight[..., None]
    system = np.einsum("pik,pil->pkl", weighted, rows)
    trace = np.trace(system, axis1=1, axis2=2)[:, None, None]
    system += (1e-12 * trace + 1e-30) * np.eye(rows.shape[-1])
    return np.linalg.solve(system, np.einsum("pik,pi->pk", weighted, values)[..., None])[..., 0]


def _finish(normal: np.ndarray, spectrum: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give unit normals that face the camera, and reflectances, from two factors of which both may be negative."""
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    sign = np.where(normal[:, 2:] < 0, -1.0, 1.0)
    unit = np.where(length > 0, sign * normal / np.maximum(length, 1e-30), [0.0, 0.0, 1.0])
    return unit, np.clip(sign * length * spectrum, 0.0, 1.0)
