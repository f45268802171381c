"""Normals of one round."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.metrics import angular_error_deg
from evsdr.model.illumination import Illumination
from evsdr.preview.decoder import Decoder, light_of
from evsdr.preview.window import take_window
from tests.support.preview_ball import ball_light, ball_normal, ball_recording
from tests.support.watched_files import N_LED

ROUND_US = 20_000 * N_LED


@pytest.mark.parametrize("crossfade", [1.0, 0.6])
def test_normals_of_one_round(crossfade):
    light, recording = ball_light(), ball_recording(crossfade)
    decode = Decoder(light, recording)
    normal, known = decode(take_window(recording, 2 * ROUND_US, 1.0, light.mask))
    error = angular_error_deg(normal, ball_normal())[known]
    assert known[light.mask].mean() > 0.9 and not known[~light.mask].any()
    assert np.median(error) < 1.5
    assert (normal[~known] == (0, 0, 1)).all()
    for share in (2.2, 2.4, 2.6, 2.8, 3.0):
        normal, known = decode(take_window(recording, share * ROUND_US, 1.0, light.mask))
    assert np.median(angular_error_deg(normal, ball_normal())[known]) < 1.5


def test_no_events_tell_nothing():
    light, recording = ball_light(), ball_recording()
    normal, known = Decoder(light, recording)(take_window(recording, 0.0, 1.0, light.mask))
    assert not known.any() and (normal == (0, 0, 1)).all()


def test_light_as_arrays():
    direction = [mi.Vector3f(0, 0, 1), mi.Vector3f(0.6, 0, 0.8)]
    irradiance = [mi.Float(2.0), mi.Float([1.0, 0.0, 3.0])]
    light = light_of(Illumination(direction, irradiance, [0, 1], dr.zeros(mi.Float)), np.ones((1, 3), bool))
    np.testing.assert_allclose(light.vector[:, 0], [[0, 0, 2]] * 3)
    np.testing.assert_allclose(light.vector[:, 1], [[0.6, 0, 0.8], [0, 0, 0], [1.8, 0, 2.4]], rtol=1e-6)
    assert 0 < light.constant < 1e-3
