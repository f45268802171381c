"""What a page holds equals what was found, within the steps that the page itself tells."""

import json
from dataclasses import replace

import numpy as np
import pytest

from evsdr.files.daylight import reflectance_to_srgb
from evsdr.metrics import angular_error_deg
from evsdr.page.codec import Layer, unpack
from evsdr.page.contents import DEEP, KNOWN, SCALED, SOLVED, TRUE, band_colours, contents
from tests.support.page_fits import make_fit


@pytest.fixture(scope="module")
def fit():
    return make_fit()


@pytest.fixture(scope="module")
def held(fit):
    return json.loads(json.dumps(contents(fit.maps, fit.signals, fit.depth, fit.truth), allow_nan=False))


def values(held, name):
    return unpack(Layer(**held["layers"][name]))


def near(held, name, expected):
    """Check a layer of a linear or logarithmic scale within half a step."""
    layer, expected = Layer(**held["layers"][name]), np.asarray(expected, float).reshape(len(expected), -1)
    got = unpack(layer)
    off = np.log(got / expected) if layer.scale == "log" else got - expected
    assert np.abs(off).max() <= layer.step * 1.001 + 1e-12, name


def test_layers_are_the_arrays(fit, held):
    stored, maps = fit.stored, fit.maps
    near(held, "normal", maps.normal[stored])
    near(held, "reflectance", maps.reflectance[stored])
    near(held, "normal_sigma_deg", maps.normal_sigma_deg[stored])
    near(held, "reflectance_sigma", maps.reflectance_sigma[stored])
    near(held, "angle_deg", angular_error_deg(maps.normal[stored], fit.truth.normal[stored]))
    square = np.square(maps.reflectance - fit.truth.reflectance).mean(axis=-1)
    near(held, "rmse", np.sqrt(square)[stored])
    near(held, "residual", fit.signals.residual)
    near(held, "light", fit.signals.modelled)
    near(held, "change_sigma", fit.signals.sigma)
    np.testing.assert_array_equal(values(held, "events")[:, 0], fit.signals.count)
    np.testing.assert_allclose(values(held, "change"), fit.signals.change, rtol=0.025, atol=2e-3)


@pytest.mark.parametrize(
    ("name", "most"), [("normal", 2e-5), ("reflectance", 1e-5), ("normal_sigma_deg", 1e-4), ("light", 1e-4)]
)
def test_steps_are_small(held, name, most):
    assert Layer(**held["layers"][name]).step < most


def test_state_tells_what_is_known(fit, held):
    bits = values(held, "state").astype(int).reshape(fit.maps.mask.shape)
    np.testing.assert_array_equal(bits & SOLVED > 0, fit.stored)
    np.testing.assert_array_equal(bits & KNOWN > 0, fit.maps.mask)
    np.testing.assert_array_equal(bits & SCALED > 0, fit.maps.mask_reflectance)
    np.testing.assert_array_equal(bits & TRUE > 0, fit.truth.mask & fit.stored)
    np.testing.assert_array_equal(bits & DEEP > 0, fit.depth.mask & fit.maps.mask)


def test_depth_of_what_is_known(fit, held):
    known = fit.maps.mask[fit.stored]
    expected = fit.depth.depth[fit.stored]
    step = Layer(**held["layers"]["depth"]).step
    assert np.abs(values(held, "depth")[known, 0] - expected[known]).max() <= 1.001 * step < 1e-4
    ties = np.zeros(fit.stored.shape, int)
    ties[fit.stored] = values(held, "ties")[:, 0]
    np.testing.assert_array_equal(ties[:, :-1] & 1 > 0, fit.depth.tied[1])
    np.testing.assert_array_equal(ties[:-1] & 2 > 0, fit.depth.tied[0])


def test_daylight_is_that_of_the_pictures(fit, held):
    linear = np.clip(fit.maps.reflectance @ np.array(held["daylight"]), 0, 1)
    shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(
        shown, reflectance_to_srgb(fit.maps.reflectance, fit.maps.band_wavelength_nm), atol=1e-9
    )


def test_maps_alone_are_enough(fit):
    held = contents(fit.maps)
    assert set(held["layers"]) == {"state", "normal", "reflectance", "normal_sigma_deg", "reflectance_sigma"}
    assert held["leds"] is None and held["camera"] is None and held["left_out"] == []
    assert len(values(held, "normal")) == np.count_nonzero(fit.maps.mask)


def test_nothing_known(fit):
    nothing = np.zeros_like(fit.maps.mask)
    held = contents(replace(fit.maps, mask=nothing, mask_reflectance=nothing))
    assert values(held, "normal").shape == (0, 3)
    json.dumps(held, allow_nan=False)


def test_an_unknown_true_reflectance_gives_no_error(fit):
    truth = replace(fit.truth, reflectance=np.zeros_like(fit.truth.reflectance))
    held = contents(fit.maps, truth=truth)
    assert "angle_deg" in held["layers"] and "rmse" not in held["layers"]


def test_signals_go_first_where_there_is_no_room(fit):
    whole = contents(fit.maps, fit.signals, fit.depth, fit.truth)
    size = sum(len(layer["data"]) for layer in whole["layers"].values())
    some = contents(fit.maps, fit.signals, fit.depth, fit.truth, most_bytes=size // 2)
    assert set(some["left_out"]) & {"light", "change"} and "normal" in some["layers"]
    assert sum(len(layer["data"]) for name, layer in some["layers"].items() if name != "state") <= size // 2
    assert set(some["layers"]) | set(some["left_out"]) == set(whole["layers"])


def test_colours_of_bands():
    red, green, blue, infrared = band_colours(np.array([650.0, 530, 450, 900]))
    assert red.argmax() == 0 and green.argmax() == 1 and blue.argmax() == 2
    assert np.ptp(infrared) == 0
