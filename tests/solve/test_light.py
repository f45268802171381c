"""Light of a pixel at a phase, against the words of the schedule."""

import mitsuba as mi
import numpy as np

from evsdr.solve.light import Light
from tests.support.random_pairs import C_W, N_BAND, Scene, derivative


def test_light_and_its_derivatives(rng):
    scene, pixel, phase = Scene.draw(rng), 4, 3.25
    light = Light(scene.table(scene.share * scene.signal), scene.pairs, mi.Float(C_W), N_BAND)
    at = mi.UInt32(pixel), mi.Float(phase), mi.Bool(True)
    total, jacobian = light.of(light.entries(*at))
    n = 2 + N_BAND
    assert np.allclose([total[0], light.at(*at)[0]], scene.light(pixel, phase, np.zeros(n))[0], rtol=1e-5)
    expected = derivative(lambda theta: np.log(scene.light(pixel, phase, theta, scene.share)[0]), n)
    np.testing.assert_allclose([float(j[0]) for j in jacobian], expected, rtol=1e-3, atol=1e-4)
