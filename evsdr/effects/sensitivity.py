"""How far normals move if something is left out of the signal model: the measure of every decision.

A fit that leaves out a change d of the signals explains it as well as it can by other normals and reflectances. To
first order these move by the least squares solution of J x = log((A + d + C_w) / (A + C_w)), with J the derivatives
of log (A + C_w) by the direction of the normal and the log reflectances: what event pairs compare.
"""

import numpy as np

RIDGE = 1e-3  # keeps pixels solvable that few LEDs light
MOST_DEG = 60.0  # no answer of first order means more
SHARE = 2000  # pixels that are asked


def signals(
    normal: np.ndarray, reflectance: np.ndarray, direction: np.ndarray, irradiance: np.ndarray, band
) -> np.ndarray:
    """Give the direct signals A_xj (n_pixel, n_led); arguments as in `expected_error_deg`."""
    cosine = np.einsum("jnk,nk->nj", direction, normal)
    return reflectance[:, band] * irradiance.T * np.maximum(cosine, 0)


def expected_error_deg(
    normal: np.ndarray,
    reflectance: np.ndarray,
    direction: np.ndarray,
    irradiance: np.ndarray,
    band: list[int],
    constant_light: float,
    change: np.ndarray,
) -> np.ndarray:
    """Give the angle by which each normal moves if signals change but the model does not.

    Parameters
    ----------
    normal : (n_pixel, 3) float
        Unit normals, camera frame.
    reflectance : (n_pixel, n_band) float
    direction : (n_led, n_pixel or 1, 3) float
        Unit vectors from surface to light.
    irradiance : (n_led, n_pixel or 1) float
        V g INT D E_j, as the model has them.
    band : (n_led) list of int
    constant_light : float
        C_w, above 0.
    change : (n_pixel, n_led) float
        What the signals really have in addition.

    Returns
    -------
    (n_pixel,) float
        Degrees, 60 at most.
    """
    n_band = reflectance.shape[1]
    direction = np.broadcast_to(direction, (len(band), len(normal), 3))
    irradiance = np.broadcast_to(irradiance, (len(band), len(normal)))
    signal = signals(normal, reflectance, direction, irradiance, band)
    level = signal + constant_light
    residual = np.log(np.maximum(level + change, constant_light) / level)
    first = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.7, (1.0, 0, 0), (0, 1.0, 0)))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    jacobian = np.zeros((*signal.shape, 2 + n_band))
    gain = reflectance[:, band] * irradiance.T * (signal > 0) / level
    for k, tangent in enumerate((first, second)):
        jacobian[..., k] = gain * np.einsum("jnk,nk->nj", direction, tangent)
    jacobian[:, np.arange(len(band)), 2 + np.asarray(band)] = signal / level
    matrix = np.einsum("nji,njk->nik", jacobian, jacobian) + RIDGE * np.eye(2 + n_band)
    right = np.einsum("nji,nj->ni", jacobian, residual)
    moved = np.linalg.solve(matrix, right[..., None])[:, :2, 0]
    return np.minimum(np.degrees(np.linalg.norm(moved, axis=1)), MOST_DEG)


def some_of(n_pixel: int) -> np.ndarray:
    """Choose at most `SHARE` pixels, evenly."""
    return np.unique(np.linspace(0, n_pixel - 1, min(n_pixel, SHARE)).round().astype(int))
