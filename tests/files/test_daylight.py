"""Colours of reflectance under daylight: the table is colour-science's, and so are the colours."""

import warnings

import numpy as np
import pytest

from evsdr.files.daylight import read_table, reflectance_to_srgb
from experiments.daylight_table import rgb_of_wavelengths

WAVELENGTH_NM = np.array([620.0, 405, 450, 470, 505, 525, 590, 660], np.float32)  # not in order


@pytest.fixture
def colour():
    with np.printoptions(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    return colour


def test_the_table_is_that_of_colour_science():
    (nm, rgb), (expected_nm, expected_rgb) = read_table(), rgb_of_wavelengths()
    np.testing.assert_array_equal(nm, expected_nm)
    np.testing.assert_allclose(rgb, expected_rgb, rtol=1e-9)
    np.testing.assert_allclose(rgb.sum(axis=0), 1, atol=2e-4)  # a white surface is white


def test_colours_are_those_of_colour_science(colour, rng):
    """By its own tables, matrix and transfer function; the darkest colours take the linear part of the last."""
    reflectance = np.concatenate([rng.random((50, 8)), 0.004 * rng.random((50, 8))])
    nm = np.arange(360.0, 781.0, 5.0)
    order = np.argsort(WAVELENGTH_NM)
    spectrum = np.stack([np.interp(nm, WAVELENGTH_NM[order], row[order]) for row in reflectance])
    weight = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"][nm]
    weight = weight * colour.SDS_ILLUMINANTS["D65"][nm][:, None]
    linear = colour.XYZ_to_RGB(spectrum @ weight / weight[:, 1].sum(), "sRGB")
    expected = colour.cctf_encoding(np.clip(linear, 0, 1), function="sRGB")
    assert (linear < 0.0031).any() and (linear > 0.0032).any()
    np.testing.assert_allclose(reflectance_to_srgb(reflectance, WAVELENGTH_NM), expected, atol=1e-7)


@pytest.mark.parametrize("wavelength_nm", [WAVELENGTH_NM, [500.0], [650.0, 450.0], [450.0, 550.0, 650.0]])
@pytest.mark.parametrize("grey", [0.0, 0.18, 1.0])
def test_flat_spectra_are_grey(wavelength_nm, grey):
    """IEC 61966-2-1: 0.18 is encoded as 1.055 * 0.18^(1/2.4) - 0.055 = 0.4614."""
    encoded = 1.055 * grey ** (1 / 2.4) - 0.055 if grey else 0.0
    srgb = reflectance_to_srgb(np.full((2, len(wavelength_nm)), grey), wavelength_nm)
    np.testing.assert_allclose(srgb, np.full((2, 3), encoded), atol=0.5 / 255)


def test_two_bands_give_their_mean_as_grey():
    srgb = reflectance_to_srgb(np.array([[0.1, 0.26]]), [650.0, 450.0])
    np.testing.assert_allclose(srgb, [[1.055 * 0.18 ** (1 / 2.4) - 0.055] * 3], rtol=1e-9)


def test_bands_of_one_wavelength_are_averaged():
    rng = np.random.default_rng(5)
    reflectance = rng.random((4, 4))
    twice = np.concatenate([reflectance[:, :1] - 0.1, reflectance[:, :1] + 0.1, reflectance[:, 1:]], axis=1)
    np.testing.assert_allclose(
        reflectance_to_srgb(twice, [640.0, 640.0, 450.0, 500.0, 560.0]),
        reflectance_to_srgb(reflectance, [640.0, 450.0, 500.0, 560.0]),
        atol=1e-12,
    )


def test_colour_checker_keeps_its_colours(colour):
    """Eight bands of 24 nm width sample the 24 patches; their colours come within 20 of 255, 4 on average.

    The loss is that of linear interpolation across the gaps between the LEDs, most in yellow and red.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patches = [sd.copy() for sd in colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()]
        light = colour.SDS_ILLUMINANTS["D65"]
        xyz = np.array([colour.sd_to_XYZ(sd, illuminant=light) / 100 for sd in patches])
        truth = np.clip(colour.XYZ_to_sRGB(xyz), 0, 1)
    band = np.exp(-0.5 * ((patches[0].wavelengths - WAVELENGTH_NM[:, None]) / 10) ** 2)
    reflectance = np.array([sd.values for sd in patches]) @ (band / band.sum(axis=1, keepdims=True)).T
    error = 255 * np.abs(reflectance_to_srgb(reflectance, WAVELENGTH_NM) - truth)
    assert len(error) == 24 and error.max() < 20 and error.mean() < 4
