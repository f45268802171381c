"""A sphere under a ring of far LEDs in plain NumPy: an independent twin of renderer and scene."""

import numpy as np

N_LED, N_BAND = 24, 8


def ring_directions(n_led: int = N_LED, polar_deg: float = 45.0) -> np.ndarray:
    """Give unit vectors (n_led, 3) from surface to light, in the camera frame."""
    azimuth, polar = 2 * np.pi * np.arange(n_led) / n_led, np.radians(polar_deg)
    return np.column_stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.full(n_led, np.cos(polar))]
    )


def sphere_normals(size: int, extent: float = 1.15) -> tuple[np.ndarray, np.ndarray]:
    """Give normals (size, size, 3) of the unit sphere at pixel centres, and where it is."""
    x = ((np.arange(size) + 0.5) / size * 2 - 1) * extent
    x, y = np.meshgrid(x, -x)
    z2 = 1 - x**2 - y**2
    return np.stack([x, y, np.sqrt(np.maximum(z2, 0))], axis=-1), z2 > 0.02


def lambert_signals(normal: np.ndarray, reflectance: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Give A_xj = R_b max(0, n . l_j) for unit LEDs, band j mod n_band; (n_led, ...)."""
    band = np.arange(len(direction)) % reflectance.shape[-1]
    shade = np.maximum(np.einsum("...k,jk->j...", normal, direction), 0)
    return shade * np.moveaxis(reflectance[..., band], -1, 0)
