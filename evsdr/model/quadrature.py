"""Spectra of the LEDs: bands, and Gauss quadrature of what the camera sees of them."""

import numpy as np

# Mitsuba's spectral range, finer than any LED.
WAVELENGTH_NM = np.arange(360.0, 830.5, 0.5)
N_NODE = 4  # the wavelengths that travel together in `si.wavelengths`
TOLERANCE = 0.012  # error of a band's reflectance that is worth nodes of its own; that of smooth ones is less (measured)
Curve = tuple[np.ndarray, np.ndarray]  # wavelengths [nm] and values; linear between, 0 outside


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


def quadrature_for(
    density: np.ndarray, curves: list[Curve], n_node: int = N_NODE, tolerance: float = TOLERANCE
) -> tuple[np.ndarray, np.ndarray]:
    """Find nodes and weights that integrate some curves against a spectrum, as far as that many nodes can.

    Gauss's, unless they miss a curve: where one has an edge within the band. Then nodes among `WAVELENGTH_NM` with weights
    by non-negative least squares (Lawson and Hanson 1974, "Solving Least Squares Problems", chapter 23), which leaves no
    more nodes than equations. These are the curves, or their first principal components, and then moments. Nodes that do
    so exactly exist (Tchakaloff 1957).

    Parameters
    ----------
    density : (n_wavelength,) float
        Spectrum over `WAVELENGTH_NM`, >= 0, with a positive integral.
    curves : list of Curve
        What will be integrated.

    Returns
    -------
    wavelength_nm, weight : (n_node,) float
        As of `gauss_quadrature`.
    """
    rule = gauss_quadrature(density, n_node)
    exact = np.array([mean_of(curve, density) for curve in curves])
    if _largest_error(rule, curves, exact) <= tolerance:
        return rule
    place = np.flatnonzero(density > 1e-6 * density.max())
    nm = WAVELENGTH_NM[place]
    values = np.array([_at(curve, nm) for curve in curves])
    measure = density[place] / density[place].sum()
    x = (nm - measure @ nm) / max(np.sqrt(measure @ (nm - measure @ nm) ** 2), 1e-9)
    around = values - exact[:, None]
    components, size, _ = np.linalg.svd(around * np.sqrt(measure), full_matrices=False)
    rows = [np.ones(len(nm)), *(components.T @ around)[size > 1e-6 * size[0]][: n_node - 1]]
    sought = [1.0] + [0.0] * (len(rows) - 1)
    moments = [(x**k, measure @ x**k) for k in range(1, n_node)]
    for row, value in moments[: n_node - len(rows)]:
        rows.append(row)
        sought.append(value)
    from scipy.optimize import nnls  # late: many scenes need no quadrature

    weight, _ = nnls(np.array(rows), np.array(sought))
    chosen = np.argsort(-weight)[:n_node]
    chosen = np.sort(chosen)
    found = nm[chosen], weight[chosen] / weight[chosen].sum()
    found = tuple(
        np.pad(part, (0, n_node - len(chosen)), mode) for part, mode in zip(found, ("edge", "constant"))
    )
    return min((rule, found), key=lambda one: _largest_error(one, curves, exact))


def mean_of(curve: Curve, density: np.ndarray) -> float:
    """Average a curve over a spectrum on `WAVELENGTH_NM`, exactly: both are linear between their points."""
    nm = np.union1d(WAVELENGTH_NM, np.clip(curve[0], WAVELENGTH_NM[0], WAVELENGTH_NM[-1]))
    inside = np.stack([nm[:-1], 0.5 * (nm[:-1] + nm[1:]), nm[1:]])
    inside[0], inside[2] = (
        np.nextafter(inside[0], np.inf),
        np.nextafter(inside[2], -np.inf),
    )  # sides of a jump
    product = np.interp(inside, WAVELENGTH_NM, density) * _at(curve, inside)
    return float(np.diff(nm) @ (np.array([1, 4, 1]) @ product) / 6 / integrate(density))


def cell_means(curve: Curve) -> np.ndarray:
    """Lay a spectrum out on `WAVELENGTH_NM` so that its integral stays, however narrow its lines are."""
    step = WAVELENGTH_NM[1] - WAVELENGTH_NM[0]
    nm = np.union1d(np.union1d(WAVELENGTH_NM, WAVELENGTH_NM[:-1] + 0.5 * step), curve[0])
    nm = nm[(nm >= WAVELENGTH_NM[0]) & (nm <= WAVELENGTH_NM[-1])]
    inside = np.stack([np.nextafter(nm[:-1], np.inf), np.nextafter(nm[1:], -np.inf)])
    amount = np.diff(nm) * _at(curve, inside).mean(axis=0)
    cell = np.rint((0.5 * (nm[:-1] + nm[1:]) - WAVELENGTH_NM[0]) / step).astype(int)
    return np.bincount(cell, amount, len(WAVELENGTH_NM)) / trapezoid_weights()


def _at(curve: Curve, nm: np.ndarray) -> np.ndarray:
    return np.interp(nm, *curve, left=0.0, right=0.0)


def _largest_error(rule: tuple, curves: list[Curve], exact: np.ndarray) -> float:
    return max((abs(rule[1] @ _at(curve, rule[0]) - e) for curve, e in zip(curves, exact)), default=0.0)
