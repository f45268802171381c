"""Parts of the event pixel's loop: its random numbers, its answer to light, its search for crossings."""

import numpy as np
import pytest

from evsdr.events.pixel_kernel import (
    CHANGE,
    LED_CHANGE,
    SMALLEST_THRESHOLD,
    _draw_normals,
    _draw_thresholds,
    _draw_uniform,
    _find_crossing,
    _gone,
    _kept_in_noise_step,
    _look,
    _on_circle,
    _Step,
    _with_slopes,
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
    np.testing.assert_allclose([_gone(t) for t in time], -np.expm1(-time), rtol=1e-14)
    short = np.linspace(0.4, 0.6, 50)
    np.testing.assert_allclose([_kept_in_noise_step(t) for t in short], np.exp(-short), rtol=1e-15)


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


@pytest.mark.parametrize("slope, transient", [(-0.004, 0.0), (0.02, 0.0), (0.01, -0.3), (0.0, 0.5)])
def test_the_photoreceptor_answers_light(slope, transient):
    """dv/dx = cutoff I (log I - v) in small steps, also where LEDs rise, as long as log I changes by CHANGE at most."""
    cutoff, led_rate, flat, start = 0.05, 0.02, 1.0, -0.4
    x = 0.0
    for _ in range(12):
        light = flat + slope * x + transient * np.exp(-led_rate * x)
        length = CHANGE * light / (abs(slope) + abs(transient) * led_rate * np.exp(-led_rate * x))
        if transient:
            left = abs(transient) * np.exp(-led_rate * x)
            length = min(length, LED_CHANGE / led_rate * (light / left) ** 0.25)
        grid, dx = np.linspace(x, x + length, 4001, retstep=True)
        path = flat + slope * grid + transient * np.exp(-led_rate * grid)
        v = [start]
        for before, after in zip(path[:-1], path[1:]):
            gone = -np.expm1(-cutoff * dx * (before + after) / 2)
            v.append(v[-1] + (np.log(before * after) / 2 - v[-1]) * gone)
        rest = transient * np.exp(-led_rate * x)
        step = _Step(
            length, flat + slope * x, slope, rest, led_rate, cutoff, np.log(light) - start, 0.0, 0.0, 0.0
        )
        rates = [slope - led_rate * transient * np.exp(-led_rate * at) for at in (x, x + length)]
        step = _with_slopes(step, rates[0] / light**2, rates[1] / path[-1] ** 2, np.log(path[-1] / light))
        for part in (0, 1000, 2500, 4000):
            here = _look(length * part / 4000, step)
            assert here.light == pytest.approx(path[part], rel=1e-12)
            assert here.value == pytest.approx(v[part], abs=2e-5)
            assert here.rate == pytest.approx(cutoff * path[part] * (np.log(path[part]) - v[part]), abs=2e-6)
        x, start = x + length, v[-1]


@pytest.mark.parametrize("leak", [0.0, 0.01])
@pytest.mark.parametrize("goal", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("cutoff", [0.0, 0.1])
def test_crossings_are_where_they_are(cutoff, goal, leak):
    """A step of light behind an LED that rises: the target at a share of the way is met to rounding."""
    length = 3.0 if cutoff else 20.0
    step = _Step(length, 1.0, 0.05, -0.4, 0.2, cutoff, np.log(0.6 / 0.5), 0.0, 0.0, 0.0)
    after = 0.4 * np.exp(-0.2 * length)
    then = 1 + 0.05 * length - after
    if cutoff:
        step = _with_slopes(step, 0.13 / 0.36, (0.05 + 0.2 * after) / then**2, np.log(then / 0.6))
    else:
        assert _look(length, step).value == pytest.approx(np.log(then), abs=1e-14)

    def value(x):
        return _look(x, step).value + leak * x

    target = value(goal * length)
    x = _find_crossing(0.0, length, value(0.0) - target, value(length) - target, target, leak, step)
    assert x == pytest.approx(goal * length, abs=1e-9)
