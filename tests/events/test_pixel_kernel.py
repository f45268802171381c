"""Parts of the event pixel's loop: its random numbers, its answer to light, its search for crossings."""

import numpy as np
import pytest

from evsdr.events.pixel_kernel import (
    SMALLEST_THRESHOLD,
    _draw_normals,
    _draw_thresholds,
    _draw_uniform,
    _find_crossing,
    _gone,
    _lag,
    _log_intensity,
    _on_circle,
    _Step,
)


def draws(draw, n, *given):
    """Draw n times from one stream."""
    state, out = np.uint64(1), []
    for _ in range(n):
        state, *values = draw(state, *given)
        state = np.uint64(state)
        out.append(values)
    return np.array(out)


def test_splitmix64():
    """The first numbers of the published generator for seed 0 (Steele et al. 2014; Vigna's splitmix64.c)."""
    state = np.uint64(0)
    for expected in (0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F):
        state, u = _draw_uniform(state)
        state = np.uint64(state)
        assert u == ((expected >> 11) + 0.5) * 2.0**-53


def test_functions_are_right_to_rounding(rng):
    turn, time = rng.random(2000), 10 ** rng.uniform(-12, 2, 2000)
    found = np.array([_on_circle(t) for t in [*turn, *np.arange(9) / 8]])
    angle = 2 * np.pi * np.append(turn, np.arange(9) / 8)
    np.testing.assert_allclose(found, np.stack([np.cos(angle), np.sin(angle)], 1), rtol=0, atol=1e-15)
    np.testing.assert_allclose([_gone(t) for t in time], -np.expm1(-time), rtol=1e-15)


def test_normal_deviates():
    z = draws(_draw_normals, 40_000)
    np.testing.assert_allclose(z.mean(axis=0), 0, atol=0.02)
    np.testing.assert_allclose(np.cov(z.T), np.eye(2), atol=0.02)
    assert np.mean(np.abs(z) < 1) == pytest.approx(0.6827, abs=0.005)
    assert np.mean(z**4) == pytest.approx(3, abs=0.1)


def test_thresholds_in_force():
    """Each is spread about its own mean, and none is smaller than the smallest."""
    on, off = draws(_draw_thresholds, 20_000, 0.2, 0.4, 0.1).T
    assert (on.mean(), off.mean()) == pytest.approx((0.2, 0.4), rel=0.01)
    assert (on.std(), off.std()) == pytest.approx((0.02, 0.04), rel=0.03)
    assert abs(np.corrcoef(on, off)[0, 1]) < 0.03
    assert draws(_draw_thresholds, 500, 0.025, 0.4, 0.5).min() == SMALLEST_THRESHOLD
    np.testing.assert_array_equal(draws(_draw_thresholds, 3, 0.2, 0.4, 0.0), np.tile([0.2, 0.4], (3, 1)))


@pytest.mark.parametrize("bend", [0.0, 0.3])
def test_the_photoreceptor_answers_a_parabola(bend):
    """dv/ds = log I - v, for log I a parabola in its own time s, in small steps."""
    whole, begin, end, start = 0.8, -1.0, 0.4, -1.3
    n = 80_000
    ds = whole / n
    s = (np.arange(n) + 0.5) * ds
    log_light = begin + (end - begin) * s / whole + bend * s * (s - whole)
    v = start
    for k, target in enumerate(log_light):
        v = target + (v - target) * np.exp(-ds)
        if k == n // 2 - 1:
            half = v
    for own_time, expected in ((whole / 2, half), (whole, v)):
        found = _lag(start, begin, end, bend, own_time, whole, 1 - np.exp(-own_time))
        assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("leak", [0.0, 0.01])
@pytest.mark.parametrize("goal", [0.1, 0.5, 0.9])
def test_crossings_are_where_they_are(goal, leak):
    """A step of light behind an LED that rises: the target at a share of the way is met to rounding."""
    step = _Step(20.0, 1.0, 0.05, -0.4, 0.2, 0.0, 0.0, np.log(0.6), 0.0, 0.0, 0.0, 0.0, 0.0)

    def value(x):
        return np.log(1.0 + 0.05 * x - 0.4 * np.exp(-0.2 * x)) + leak * x

    assert _log_intensity(7.0, step) + leak * 7.0 == pytest.approx(value(7.0), abs=1e-14)
    target = value(goal * 20.0)
    x = _find_crossing(0.0, 20.0, value(0.0) - target, value(20.0) - target, target, leak, step)
    assert x == pytest.approx(goal * 20.0, abs=1e-9)
