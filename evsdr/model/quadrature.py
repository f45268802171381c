"""Spectra of the LEDs: bands, and Gauss quadrature of what the camera sees of them."""

import numpy as np

# Mitsuba's spectral range, finer than any LED.
WAVELENGTH_NM = np.arange(360.0, 830.5, 0.5)
N_NODE = 4  # the wavelengths that travel together in `si.wavelengths`


def integrate(density: np.ndarray) -> np.ndarray:
    """Integrate spectra over `WAVELENGTH_NM` by the trapezoid rule.

    Parameters
    ----------
    density : (..., n_wavelength) float
        Spectral density [1/nm].

    Returns
    -------
    (...) float
        Integral.
    """
    return np.trapezoid(density, WAVELENGTH_NM, axis=-1)


def trapezoid_weights() -> np.ndarray:
    """Give the weights (n_wavelength,) [nm] that `integrate` has."""
    return integrate(np.eye(len(WAVELENGTH_NM)))


def group_bands(density: np.ndarray, tolerance: float = 0.01) -> np.ndarray:
    """Number the bands: LEDs whose spectra have the same shape share one.

    Parameters
    ----------
    density : (n_led, n_wavelength) float
        Spectra D E_j of the LEDs as the camera sees them, each with a positive integral.
    tolerance : float
        Largest integral of |a - b| between unit spectra of one band. 0.01 is a shift of about 0.1 nm of a
        20 nm wide LED and costs 0.1 % of the reflectance.

    Returns
    -------
    (n_led,) int
        Band of each LED; bands are numbered by the first LED of each.
    """
    unit = density / integrate(density)[:, None]
    first: list[int] = []
    band = np.empty(len(unit), int)
    for j, shape in enumerate(unit):
        distance = integrate(np.abs(unit[first] - shape)) if first else np.empty(0)
        if len(distance) and distance.min() <= tolerance:
            band[j] = distance.argmin()
        else:
            band[j] = len(first)
            first.append(j)
    return band


def gauss_quadrature(density: np.ndarray, n_node: int = N_NODE) -> tuple[np.ndarray, np.ndarray]:
    """Find nodes and weights that integrate smooth functions against a spectrum.

    The recurrence coefficients of the polynomials orthogonal under the spectrum come from the Lanczos
    process; their Jacobi matrix holds nodes and weights (Golub and Welsch 1969, "Calculation of Gauss
    quadrature rules"). Exact for polynomials of degree 2 n_node - 1.

    Parameters
    ----------
    density : (n_wavelength,) float
        Spectrum over `WAVELENGTH_NM`, >= 0, with a positive integral.
    n_node : int
        Number of nodes.

    Returns
    -------
    wavelength_nm : (n_node,) float
        Nodes [nm]; where the spectrum has fewer lines than that, the last ones carry no weight.
    weight : (n_node,) float
        Weights, sum 1.
    """
    measure = np.clip(density, 0, None) / np.sum(np.clip(density, 0, None))
    mean = measure @ WAVELENGTH_NM
    x = (WAVELENGTH_NM - mean) / 100.0
    basis = [np.sqrt(measure)]
    diagonal, off_diagonal = [], []
    for _ in range(n_node):
        v = x * basis[-1]
        diagonal.append(v @ basis[-1])
        for b in basis:  # full orthogonalisation keeps the few steps exact
            v = v - (v @ b) * b
        norm = np.linalg.norm(v)
        if norm < 1e-7:
            break
        off_diagonal.append(norm)
        basis.append(v / norm)
    n = len(diagonal)
    jacobi = np.diag(diagonal) + np.diag(off_diagonal[: n - 1], 1) + np.diag(off_diagonal[: n - 1], -1)
    node, vector = np.linalg.eigh(jacobi)
    weight = vector[0] ** 2
    padding = n_node - n
    wavelength_nm = np.append(mean + 100.0 * node, np.full(padding, mean + 100.0 * node[-1]))
    return wavelength_nm, np.append(weight, np.zeros(padding))
