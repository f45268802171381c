"""Quadrature against closed forms and brute force; which LEDs share a band."""

import numpy as np
import pytest

from evsdr.model.quadrature import (
    TOLERANCE,
    WAVELENGTH_NM,
    cell_means,
    gauss_quadrature,
    group_bands,
    integrate,
    mean_of,
    quadrature_for,
)


def led(peak_nm, sigma_nm=8.0):
    return np.exp(-0.5 * ((WAVELENGTH_NM - peak_nm) / sigma_nm) ** 2)


def lines(*line):
    """Spectrum of single grid points: (wavelength, power)."""
    density = np.zeros_like(WAVELENGTH_NM)
    for nm, power in line:
        density[np.flatnonzero(WAVELENGTH_NM == nm)] = power
    return density


SPECTRA = {
    "gaussian": led(525, 14),
    "skewed": led(450, 6) + 0.4 * led(470, 20),
    "white": led(450, 9) + 1.3 * led(560, 50),
    "rough": np.random.default_rng(0).uniform(0, 1, len(WAVELENGTH_NM)) * led(600, 15),
    "flat": np.ones_like(WAVELENGTH_NM),
}


def test_integral_of_a_line_over_all_wavelengths():
    assert integrate(2 * WAVELENGTH_NM) == pytest.approx(830.0**2 - 360.0**2)
    assert integrate(np.ones((3, len(WAVELENGTH_NM)))) == pytest.approx(470.0)


@pytest.mark.parametrize("name", SPECTRA)
@pytest.mark.parametrize("degree", range(8))
def test_quadrature_is_exact_for_polynomials_of_degree_7(name, degree):
    density = SPECTRA[name]
    nm, weight = gauss_quadrature(density)
    centre = density @ WAVELENGTH_NM / density.sum()
    spread = np.sqrt(density @ (WAVELENGTH_NM - centre) ** 2 / density.sum())
    exact = density @ ((WAVELENGTH_NM - centre) / spread) ** degree / density.sum()
    assert weight @ ((nm - centre) / spread) ** degree == pytest.approx(exact, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", SPECTRA)
def test_nodes_lie_inside_and_weights_are_positive(name):
    nm, weight = gauss_quadrature(SPECTRA[name])
    assert (weight > 0).all()
    assert weight.sum() == pytest.approx(1)
    assert WAVELENGTH_NM[0] < nm[0] < nm[1] < nm[2] < nm[3] < WAVELENGTH_NM[-1]


def test_smooth_reflectances_against_brute_force(rng):
    """LEDs 20 nm wide, reflectances with edges of 9 to 44 nm (10 to 90 %): rms error below 0.2 %, three nodes miss it."""
    edge = rng.uniform(400, 700, (200, 3, 1))
    width = rng.uniform(4, 20, (200, 3, 1))
    step = rng.uniform(-0.15, 0.15, (200, 3, 1))

    def reflectance(nm):
        return 0.5 + np.sum(step * np.tanh((nm - edge) / width), axis=1)

    error = []
    for peak_nm in (405, 430, 460, 490, 525, 560, 595, 635):
        density = led(peak_nm, 8.5)
        nm, weight = gauss_quadrature(density)
        exact = integrate(density * reflectance(WAVELENGTH_NM)) / integrate(density)
        error.append(reflectance(nm) @ weight - exact)
    assert np.sqrt(np.mean(np.square(error))) < 0.002 * 0.5


def test_single_line_needs_one_node():
    nm, weight = gauss_quadrature(lines((532, 3.0)))
    np.testing.assert_allclose(nm, 532)
    np.testing.assert_allclose(weight, [1, 0, 0, 0], atol=1e-12)


def test_two_lines_are_exact():
    nm, weight = gauss_quadrature(lines((450, 1.0), (620.5, 3.0)))
    np.testing.assert_allclose(nm[:2], [450, 620.5])
    np.testing.assert_allclose(weight, [0.25, 0.75, 0, 0], atol=1e-9)


@pytest.mark.parametrize("n_node", [1, 2, 3, 6])
def test_number_of_nodes(n_node):
    nm, weight = gauss_quadrature(led(500), n_node)
    assert len(nm) == len(weight) == n_node
    assert weight @ nm == pytest.approx(500)
    assert weight @ (nm - 500) ** 2 == pytest.approx(64 if n_node > 1 else 0, rel=1e-6)


def test_bands_are_numbered_by_their_first_led():
    density = np.array([led(600), 5 * led(450), 0.2 * led(600), led(450), led(525), led(600)])
    np.testing.assert_array_equal(group_bands(density), [0, 1, 0, 1, 2, 0])


@pytest.mark.parametrize(("shift_nm", "shared"), [(0.0, True), (0.05, True), (0.5, False), (2.0, False)])
def test_shifted_leds_leave_the_band(shift_nm, shared):
    band = group_bands(np.array([led(525, 8.5), led(525 + shift_nm, 8.5)]))
    assert band.tolist() == ([0, 0] if shared else [0, 1])


def edge(nm, low=0.1, high=0.9):
    return np.array([360, nm - 0.05, nm + 0.05, 830]), np.array([low, low, high, high])


SMOOTH = (np.array([360.0, 500, 600, 830]), np.array([0.2, 0.3, 0.6, 0.7]))


def by_brute_force(curve, density):
    nm = np.linspace(360, 830, 4_700_001)
    weight = np.interp(nm, WAVELENGTH_NM, density)
    return weight @ np.interp(nm, *curve) / weight.sum()


@pytest.mark.parametrize("nm", [521.3, 525.0, 540.0])
def test_means_of_curves_are_exact(nm):
    assert mean_of(edge(nm), led(525)) == pytest.approx(by_brute_force(edge(nm), led(525)), abs=1e-6)


def test_smooth_curves_keep_gauss():
    for mine, gauss in zip(quadrature_for(led(525, 14), [SMOOTH]), gauss_quadrature(led(525, 14))):
        np.testing.assert_array_equal(mine, gauss)
    np.testing.assert_array_equal(quadrature_for(led(525), [])[0], gauss_quadrature(led(525))[0])


@pytest.mark.parametrize("width", [1.0, 8.0, 60.0])
@pytest.mark.parametrize("n_edge", [1, 2, 3])
def test_curves_with_edges_are_integrated_exactly(width, n_edge):
    """As many curves as leave one equation for the sum of the weights."""
    density = led(550, width)
    curves = [edge(550 + offset * width) for offset in (0.4, -0.7, 1.1)[:n_edge]]
    gauss = gauss_quadrature(density)
    assert max(abs(gauss[1] @ np.interp(gauss[0], *c) - mean_of(c, density)) for c in curves) > TOLERANCE
    nm, weight = quadrature_for(density, curves)
    assert len(nm) == len(weight) == 4 and (weight >= 0).all() and weight.sum() == pytest.approx(1)
    for curve in curves:
        assert weight @ np.interp(nm, *curve) == pytest.approx(mean_of(curve, density), abs=1e-3)


def test_more_curves_than_nodes_are_no_worse_than_by_gauss(rng):
    density = led(550, 30)
    curves = [edge(nm, *rng.random(2)) for nm in rng.uniform(500, 600, 12)]
    error = [
        max(abs(weight @ np.interp(nm, *c) - mean_of(c, density)) for c in curves)
        for nm, weight in (quadrature_for(density, curves), gauss_quadrature(density))
    ]
    assert error[0] <= error[1]
    nm, weight = quadrature_for(density, curves, 16, 1e-3)
    assert max(abs(weight @ np.interp(nm, *c) - mean_of(c, density)) for c in curves) < 1e-3


@pytest.mark.parametrize("nm", [532.0, 532.2, 532.25, 359.999, 830.001])
def test_narrow_lines_keep_their_power(nm):
    line = np.array([nm - 0.01, nm, nm + 0.01]), np.array([0, 100.0, 0])
    inside = 1.0 if 360 < nm < 830 else 0.405
    assert integrate(cell_means(line)) == pytest.approx(inside, rel=1e-6)
