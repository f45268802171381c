"""Unknowns to maps and back."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.solve.unknowns import (
    LARGEST_SLOPE,
    LARGEST_STEP,
    LOG_COLOUR_SIGMA,
    LOG_COMMON_SIGMA,
    LOG_REFLECTANCE_RANGE,
    REFLECTANCE_CENTRE,
    SLOPE_SIGMA,
    Unknowns,
    fill,
    first_theta,
    log_spread,
    to_normal,
    to_theta,
    weak_prior,
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


def test_what_is_known_before_any_event_is_a_gaussian(rng):
    """Cost, gradient and matrix against dense ones: all bands share a scale, each has a colour."""
    n_band, n_pixel = 3, 5
    theta = rng.normal(-0.5, 1, (n_pixel, 2 + n_band + 2))
    covariance = np.zeros((7, 7))
    covariance[:2, :2] = SLOPE_SIGMA**2 * np.eye(2)
    covariance[2:5, 2:5] = LOG_COMMON_SIGMA**2 + LOG_COLOUR_SIGMA**2 * np.eye(n_band)
    covariance[5:, 5:] = np.diag([0.2**2, 0.1**2])
    centre = np.array([0, 0, *[np.log(REFLECTANCE_CENTRE)] * n_band, 0.05, -0.02])
    weight = np.repeat((0.5, 1.0), (5, 2))
    precision = np.linalg.inv(covariance) * np.sqrt(np.outer(weight, weight))
    spread = [mi.Float(v) for v in (0.05, -0.02, 0.2, 0.1)]
    arrays = [mi.Float(column) for column in theta.T]
    cost, gradient, matrix = Unknowns(n_band, True).prior(arrays, spread, mi.Float(0.5))
    off = theta - centre
    np.testing.assert_allclose(cost.numpy(), 0.5 * np.einsum("ni,ij,nj->n", off, precision, off), rtol=1e-4)
    np.testing.assert_allclose(
        np.stack([g.numpy() for g in gradient], -1), off @ precision, rtol=1e-3, atol=1e-4
    )
    entries = [np.broadcast_to(v if isinstance(v, float) else v.numpy(), 1)[0] for v in matrix]
    np.testing.assert_allclose(entries, precision[np.tril_indices(7)], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(weak_prior(n_band)[1], np.linalg.inv(covariance)[:5, :5], atol=1e-9)


def test_how_far_quantities_are_whose_logarithms_are_normal(rng):
    """As draws have it, and as their logarithms where these hardly scatter."""
    log = rng.normal(size=200_000)
    for sigma in (0.2, 0.5):
        drawn = np.sqrt(np.mean(np.square(np.exp(sigma * log) - 1)))
        assert log_spread(np.array(sigma**2)) == pytest.approx(drawn, rel=0.02)
    np.testing.assert_allclose(log_spread(np.array([0, 1e-8])), [0, 1e-4], rtol=1e-3)
    assert np.isfinite(log_spread(np.array([1e9, -1e-9]))).all()
