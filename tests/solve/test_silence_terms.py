"""Normal equations of silences against a plain loop."""

import mitsuba as mi
import numpy as np
import pytest
from scipy import special, stats

from evsdr.solve import law
from evsdr.solve.silence_terms import JITTER, silence_equations
from tests.support.random_pairs import C_W, N_BAND, N_PIXEL, SCALE, N, Scene, derivative


@pytest.fixture
def scene(rng):
    return Scene.draw(rng)


def survival(y):
    return (1 - law.SHARE) * special.ndtr(y) + law.SHARE * stats.t.cdf(y, 3)


def room(scene, i, k, side, extreme, theta):
    """How far the threshold of a side is from having been reached, in standard deviations."""
    threshold = scene.threshold(i, side, theta) * SCALE
    if scene.ended[k] == side:
        return side * scene.change(i, extreme, scene.end[k], theta) / (JITTER * threshold)
    change = scene.change(i, scene.start[k], extreme, theta) + scene.silent_bias[k]
    return 1 / SCALE - side * change / threshold


@pytest.mark.parametrize("thresholds", [False, True])
def test_silence_says_which_thresholds_were_not_reached(scene, thresholds):
    """The most extreme of three probes counts, to each side; the side that fired is compared with its event."""
    n, zero = N if thresholds else 2 + N_BAND, np.zeros(N)
    given = mi.Float(C_W), N_BAND, mi.Float(SCALE), thresholds
    cost, gradient, matrix = silence_equations(scene.table(), scene.pairs, *given)
    n_side = dict.fromkeys(("other", "own", "none"), 0)
    for i in range(N_PIXEL):
        expected, slope, bends = 0.0, np.zeros(n), np.zeros((n, n))
        for k in range(scene.offset[i], scene.offset[i + 1]):
            for side in (1, -1):
                change = [side * scene.change(i, scene.start[k], at, zero) for at in scene.probe[k]]
                if max(change) <= 0:
                    n_side["none"] += 1
                    continue
                n_side["own" if scene.ended[k] == side else "other"] += 1
                extreme = scene.probe[k][int(np.argmax(change))]

                def y(theta, i=i, k=k, side=side, extreme=extreme):
                    return room(scene, i, k, side, extreme, theta)

                _, m, bend = (float(v[0]) for v in law.survival(mi.Float(y(zero))))
                jacobian = derivative(y)[:n]
                expected -= np.log(survival(y(zero)))
                slope -= m * jacobian
                bends += bend * np.outer(jacobian, jacobian)
        np.testing.assert_allclose(cost.numpy()[i], expected, rtol=2e-3, atol=1e-4)
        largest = np.abs(slope).max() + 1e-6
        np.testing.assert_allclose([g.numpy()[i] for g in gradient], slope, rtol=5e-3, atol=2e-3 * largest)
        triangle = bends[np.tril_indices(n)]
        found = np.array([v.numpy()[i] for v in matrix])
        np.testing.assert_allclose(found, triangle, rtol=5e-3, atol=5e-3 * np.abs(triangle).max() + 1e-6)
    assert min(n_side.values()) > 15
