"""Lambertian signals against plain NumPy and automatic differentiation."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing, led_signals, soft_max0, soft_max0_derivative
from tests.support.analytic import lambert_signals, ring_directions


def make_ring(visibility=1.0) -> Illumination:
    direction = [mi.Vector3f(*d) for d in ring_directions().tolist()]
    return Illumination(direction, [mi.Float(visibility)] * 24, [j % 8 for j in range(24)], mi.Float(0.05))


@pytest.fixture
def surface(rng):
    """Slopes and reflectances of 200 pixels."""
    p, q = rng.normal(0, 0.8, (2, 200)).astype(np.float32)
    return p, q, rng.uniform(0.05, 0.9, (200, 8)).astype(np.float32)


def test_soft_horizon_is_positive_and_becomes_hard():
    x = np.linspace(-1, 1, 101, dtype=np.float32)
    assert np.min(soft_max0(mi.Float(x), 0.3).numpy()) > 0
    np.testing.assert_allclose(soft_max0(mi.Float(x), 1e-3).numpy(), np.maximum(x, 0), atol=6e-4)


@pytest.mark.parametrize("softness", [0.02, 0.3])
def test_soft_horizon_derivative_is_that_of_finite_differences(softness):
    x, h = np.linspace(-1, 1, 41), 1e-3
    f = lambda x: 0.5 * (x + np.sqrt(x**2 + softness**2))
    numeric = (f(x + h) - f(x - h)) / (2 * h)
    np.testing.assert_allclose(soft_max0_derivative(mi.Float(x), softness).numpy(), numeric, atol=2e-3)


def test_signals_are_those_of_numpy(surface):
    p, q, reflectance = surface
    normal = np.column_stack([-p, -q, np.ones_like(p)])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    expected = lambert_signals(normal, reflectance, ring_directions())
    bands = [mi.Float(r) for r in reflectance.T.copy()]
    hard = led_signals(
        make_ring(), mi.Vector3f(*(mi.Float(c) for c in normal.T.astype(np.float32).copy())), bands
    )
    soft, _, _ = LambertianRing(make_ring())(mi.Float(p), mi.Float(q), bands, mi.Float(1e-4))
    np.testing.assert_allclose(np.array([s.numpy() for s in hard]), expected, atol=1e-6)
    np.testing.assert_allclose(np.array([s.numpy() for s in soft]), expected, atol=1e-4)


def test_slope_derivatives_are_those_of_automatic_differentiation(surface):
    p, q, reflectance = surface
    p, q, bands = mi.Float(p), mi.Float(q), [mi.Float(r) for r in reflectance.T.copy()]
    softness = mi.Float(0.1)
    _, by_p, by_q = LambertianRing(make_ring(0.7))(p, q, bands, softness)
    for j in (0, 7, 15):
        for variable, by in ((0, by_p), (1, by_q)):
            slopes = [mi.Float(p), mi.Float(q)]
            dr.enable_grad(slopes[variable])
            signal, _, _ = LambertianRing(make_ring(0.7))(*slopes, bands, softness)
            dr.backward(signal[j])
            np.testing.assert_allclose(by[j].numpy(), dr.grad(slopes[variable]).numpy(), rtol=2e-4, atol=2e-6)


def test_the_hard_model_agrees_with_automatic_differentiation_of_led_signals(surface):
    p, q, reflectance = surface
    bands = [mi.Float(r) for r in reflectance.T.copy()]
    light = make_ring()
    _, by_p, _ = LambertianRing(light)(mi.Float(p), mi.Float(q), bands, mi.Float(1e-4))
    slope = mi.Float(p)
    dr.enable_grad(slope)
    normal = dr.normalize(mi.Vector3f(-slope, -mi.Float(q), 1.0))
    signal = led_signals(light, normal, bands)
    dr.backward(signal[3])
    away_from_horizon = signal[3].numpy() > 1e-2
    np.testing.assert_allclose(
        by_p[3].numpy()[away_from_horizon], dr.grad(slope).numpy()[away_from_horizon], rtol=1e-3, atol=1e-5
    )
    assert away_from_horizon.sum() > 100


def test_indirect_light_joins_the_signal_and_not_its_slopes(surface, rng):
    """Reflectance times what comes by way of other surfaces, whatever the normal."""
    p, q, reflectance = surface
    p, q, bands = mi.Float(p), mi.Float(q), [mi.Float(r) for r in reflectance.T.copy()]
    more = rng.random((3, 200)).astype(np.float32)
    ring = make_ring()
    light = replace(ring, direction=ring.direction[:3], irradiance=ring.irradiance[:3], band=ring.band[:3])
    lit = replace(light, indirect=[mi.Float(row) for row in more])
    (direct, *slopes), (both, *same) = (LambertianRing(r)(p, q, bands, mi.Float(1e-4)) for r in (light, lit))
    normal = dr.normalize(mi.Vector3f(-p, -q, 1.0))
    for direct, both in (
        (direct, both),
        (led_signals(light, normal, bands), led_signals(lit, normal, bands)),
    ):
        gained = np.array([b.numpy() - a.numpy() for a, b in zip(direct, both)])
        np.testing.assert_allclose(gained, more * reflectance.T[:3], atol=1e-6)
    for a, b in zip(slopes, same):
        np.testing.assert_array_equal([v.numpy() for v in a], [v.numpy() for v in b])
