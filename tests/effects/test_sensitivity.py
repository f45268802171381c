"""How far normals move if signals change but the model does not."""

import numpy as np
import pytest

from evsdr.effects.sensitivity import (
    SHARE,
    against,
    expected_error_deg,
    look_at,
    look_at_geometry,
    mean_error,
)
from evsdr.light.ground_truth import surface_maps
from evsdr.light.tracing import led_images, trace_illumination
from tests.support.small_scene import leds, scene
from tests.support.worlds import load

POLAR = np.pi / 4


def ring_light(n_led=24, n_band=8):
    """Directions (n_led, 1, 3) and irradiances (n_led, 1) of a far ring."""
    azimuth = 2 * np.pi * np.arange(n_led) / n_led
    direction = np.stack([np.sin(POLAR) * np.cos(azimuth), np.sin(POLAR) * np.sin(azimuth)], axis=-1)
    direction = np.concatenate([direction, np.full((n_led, 1), np.cos(POLAR))], axis=-1)
    return direction[:, None], np.ones((n_led, 1)), [j % n_band for j in range(n_led)]


def signals(normal, reflectance, direction, irradiance, band):
    cosine = np.maximum(np.einsum("jnk,nk->nj", direction, normal), 0)
    return reflectance[:, band] * irradiance.T * cosine


def test_expected_error_is_the_turn_that_causes_the_change():
    """Signals of a surface turned by 1 degree: the answer is 1 degree."""
    direction, irradiance, band = ring_light()
    normal = np.array([[0.1, -0.2, 1.0], [0.0, 0.3, 1.0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    turned = normal + np.radians(1.0) * np.cross(normal, [[0, 1.0, 0], [1.0, 0, 0]])
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.sum(normal * turned, axis=1)))
    reflectance = np.full((2, 8), 0.3)
    given = normal, reflectance, direction, irradiance, band
    change = signals(turned, reflectance, direction, irradiance, band) - signals(*given)
    error = expected_error_deg(*given, 0.05, change)
    np.testing.assert_allclose(error, angle, rtol=0.05)


def test_brighter_light_turns_no_normal():
    """All LEDs stronger by one factor: reflectances explain it, without constant light exactly."""
    direction, irradiance, band = ring_light()
    given = np.array([[0.1, -0.2, 0.97]]), np.full((1, 8), 0.3), direction, irradiance, band
    change = 0.2 * signals(*given)
    assert expected_error_deg(*given, 1e-6, change)[0] < 0.05
    lopsided = change * (1 + direction[:, 0, 0])
    assert expected_error_deg(*given, 1e-6, lopsided)[0] > 2


def test_a_look_sees_the_signals_of_the_renderer(tmp_path):
    """One ray per pixel centre: the same A_xj, and none of them is 0."""
    ring = load(tmp_path, scene(light=leds(distance=4)))
    look = look_at(surface_maps(ring, 1))
    light, _ = trace_illumination(ring, 1, False)
    image = led_images(ring, 1).reshape(8, -1)[:, look.pixel].T
    np.testing.assert_allclose(look.signals(light), image, atol=2e-3)
    assert image.mean() > 0.1


def test_light_as_it_is_modelled_has_no_error(tmp_path):
    ring = load(tmp_path, scene(light=leds(distance=4)))
    light, coverage = trace_illumination(ring, 4, False)
    look = look_at_geometry(ring, coverage >= 0.5)
    far = light.far(light, look.pixel)
    assert mean_error(look, light, light) == 0
    assert 1 < mean_error(look, far, light) < 30
    nowhere = look_at_geometry(ring, np.zeros_like(coverage) > 0)
    assert len(nowhere.pixel) == 0 and mean_error(nowhere, far, light) == 0


def test_many_pixels_are_asked_evenly(tmp_path):
    from evsdr.effects.sensitivity import _some_of

    pixel = np.arange(10 * SHARE)
    some = _some_of(pixel)
    assert len(some) == SHARE and (some[0], some[-1]) == (pixel[0], pixel[-1])
    assert np.ptp(np.diff(some)) <= 1


@pytest.mark.parametrize(("modelled", "word"), [(True, "more"), (False, "less")])
def test_the_sentence_names_error_and_limit(modelled, word):
    assert against(0.123, modelled, 0.05) == f"left out, that turns normals by 0.12 degrees, {word} than 0.05"
