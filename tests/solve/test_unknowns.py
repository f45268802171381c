"""Unknowns to maps and back."""

import drjit as dr
import mitsuba as mi
import numpy as np

from evsdr.solve.unknowns import (
    LARGEST_SLOPE,
    LARGEST_STEP,
    LOG_REFLECTANCE_RANGE,
    Unknowns,
    fill,
    first_theta,
    to_normal,
    to_theta,
)


def test_maps_come_back(rng):
    normal = rng.normal(size=(50, 3)) + [0, 0, 3]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    reflectance = rng.uniform(0.02, 1.5, (50, 4))
    theta = np.stack([t.numpy() for t in to_theta(normal, reflectance, mi.Float)], axis=-1)
    np.testing.assert_allclose(to_normal(theta), normal, atol=1e-6)
    np.testing.assert_allclose(np.exp(theta[:, 2:]), reflectance, rtol=1e-5)


def test_thresholds_come_last():
    theta = first_theta(np.tile([0.0, 0.0, 1.0], (3, 1)), 2, True, mi.Float)
    unknowns = Unknowns(2, True)
    assert len(theta) == unknowns.number == 6 and unknowns.n_map == 4
    assert [g.numpy().tolist() for g in unknowns.gains(theta)] == [[1, 1, 1]] * 2
    assert len(unknowns.reflectance(theta)) == 2
    assert Unknowns(2, False).gains(theta[:4]) is None


def test_steps_are_limited():
    """In length, and to values that make sense."""
    zero = [mi.Float(0.0), mi.Float(0.0), mi.Float(0.0)]
    far = Unknowns.moved(zero, [mi.Float(99.0), mi.Float(-99.0), mi.Float(99.0)])
    assert [float(v[0]) for v in far] == [LARGEST_STEP[0], -LARGEST_STEP[0], LOG_REFLECTANCE_RANGE[1]]
    edge = [mi.Float(LARGEST_SLOPE), mi.Float(-LARGEST_SLOPE), mi.Float(LOG_REFLECTANCE_RANGE[0])]
    beyond = Unknowns.moved(edge, [mi.Float(1.0), mi.Float(-1.0), mi.Float(-1.0)])
    np.testing.assert_allclose([float(v[0]) for v in beyond], [float(v[0]) for v in edge])


def test_pixels_take_after_the_nearest_good_one():
    mask = np.array([[1, 1, 1, 1, 0, 1]], bool)
    value = mi.Float([1, 2, 3, 4, 5])
    dr.make_opaque(value)
    (filled,) = fill([value], np.array([1, 0, 0, 0, 1], bool), mask)
    np.testing.assert_array_equal(filled, [1, 1, 1, 5, 5])
    assert fill([value], np.zeros(5, bool), mask)[0] is value
