"""The foreign pixel against closed forms."""

import ast
from pathlib import Path

import numpy as np
import pytest

from tests.support import foreign_pixel, foreign_pixel_kernel
from tests.support.foreign_pixel import ForeignPixel, watch
from tests.support.foreign_pixel_kernel import NEVER, read_out, receive

SLOT_US = 20_000.0


def ramp(pixel, seed=0, n_pixel=1):
    """Let pixels watch light that grows in a straight line from 1 to 8 in one slot, and falls in the next.

    Gives x, polarity and time of what comes in the first.
    """
    signal = np.repeat([[[0.5]], [[7.5]]], n_pixel, axis=2)
    events = watch(signal, 0.5, np.arange(2), SLOT_US, 1.0, 1, pixel, seed)
    early = events.t < SLOT_US
    return events.x[early], events.p[early], events.t[early]


def steady(pixel, seed=0, n_pixel=100, light=0.5, seconds=2):
    """Let pixels watch light that does not change."""
    return watch(np.zeros((1, 1, n_pixel)), light, [0], 1e5, 0.0, 10 * seconds, pixel, seed)


def light_of(t_us):
    return 1 + 7 * t_us / SLOT_US


def time_of(light):
    return (light - 1) / 7 * SLOT_US


def test_it_shares_no_code_with_evsdr():
    for module in (foreign_pixel, foreign_pixel_kernel):
        tree = ast.parse(Path(module.__file__).read_text())
        names = [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        names += [a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names]
        assert names and not any(name.startswith("evsdr") for name in names)


@pytest.mark.parametrize("steps", [False, True])
def test_events_of_a_ramp(steps):
    """One at each threshold of log light; memorised or moved on is the same where nothing is lost."""
    _, p, t = ramp(ForeignPixel(on=0.2, steps=steps))
    assert (p == 1).all()
    np.testing.assert_allclose(
        t, time_of(np.exp(0.2 * np.arange(1, 11))), atol=1.01
    )  # ln 8 = 10.4 thresholds


def test_what_the_light_does_while_a_pixel_rests_is_lost():
    _, _, t = ramp(ForeignPixel(on=0.2, refractory_us=500))
    expected, reference = [], 1.0
    while (next_time := time_of(reference * np.exp(0.2))) < SLOT_US:
        expected.append(next_time)
        reference = light_of(next_time + 500)
    np.testing.assert_allclose(t, expected, atol=2)


def test_a_reference_that_moves_on_makes_events_late_or_drops_them():
    ideal = time_of(np.exp(0.2 * np.arange(1, 11)))  # 633, 772, 943, 1152 ... us apart
    _, _, late = ramp(ForeignPixel(on=0.2, steps=True, refractory_us=800))
    assert late[:3] == pytest.approx([ideal[0], ideal[0] + 800, max(ideal[2], ideal[0] + 1600)], abs=2)
    np.testing.assert_allclose(late[5:], ideal[5:], atol=2)
    _, _, kept = ramp(ForeignPixel(on=0.2, steps=True, refractory_us=800, drops=True))
    np.testing.assert_allclose(kept, np.delete(ideal, 1), atol=2)


@pytest.mark.parametrize("follower_us", [0.0, 150.0])
def test_lag_after_a_step(follower_us):
    """Light falls at once to 0.3: log light follows by one pole of tau / (I + dark + lag), or by two."""
    pixel = ForeignPixel(
        0.1, 0.1, steps=True, tau_us=50, dark_light=0.05, lag_light=0.08, follower_us=follower_us
    )
    signal, order = np.array([[[2.7]], [[0.0]]]), np.arange(2)
    events = watch(signal, 0.3, order, 5000.0, 0.0, 1, pixel)
    tau, light = 50 / (0.3 + 0.05 + 0.08), np.log([3.05, 0.35])
    t = np.linspace(0, 5000, 500_001)
    left = np.exp(-t / tau)
    if follower_us:
        left = (tau * left - follower_us * np.exp(-t / follower_us)) / (tau - follower_us)
    level = light[1] + (light[0] - light[1]) * left
    goals = light[0] - 0.1 * np.arange(1, 22)  # ln(3.05 / 0.35) = 21.6 thresholds
    expected = 5000 + t[np.searchsorted(-level, -goals)]
    assert (events.p == 0).all()
    # steps of 20 us, linear between, which is 1 % of the 116 us off where the level bends; the follower takes
    # the photoreceptor of each step's end
    np.testing.assert_allclose(events.t, expected, atol=2.5 if not follower_us else 12)


def test_shot_noise_has_the_variance_of_its_photons():
    """Ornstein and Uhlenbeck: speed / (2 photons I); the noise of a step is what first passage is told."""
    np.random.seed(1)  # of NumPy, which the kernel uses when it is not compiled
    pixel, level, levels, light = ForeignPixel(tau_us=50.0, lag_light=0.1, photons_per_us=20.0), 0.0, [], 0.4
    for _ in range(100_000):
        level, variance = receive.py_func(level, light, 20.0, pixel)
        levels.append(level)
    speed = 0.5 / 50
    assert np.var(levels[100:]) == pytest.approx(speed / (2 * 20 * 0.4), rel=0.03)
    assert np.mean(levels[100:]) == pytest.approx(np.log(0.4), abs=0.003)
    kept = np.cov(levels[100:-1], levels[101:])
    assert kept[0, 1] / kept[0, 0] == pytest.approx(np.exp(-speed * 20), rel=0.02)
    assert variance == pytest.approx(np.var(levels[100:]) * (1 - np.exp(-2 * speed * 20)), rel=0.03)


def test_first_passage_of_brownian_motion_with_drift():
    """Which threshold, and when: chance and mean time of leaving an interval (Borodin and Salminen 2002)."""
    drift, sigma, on, off = 2e-6, 1.2e-3, 0.2, 0.3  # per us; a threshold takes about 30 ms
    events = steady(ForeignPixel(on, off, walk_floor=sigma, leak_per_us=drift), light=1.0, seconds=5)
    k = 2 * drift / sigma**2
    up = (1 - np.exp(k * off)) / (np.exp(-k * on) - np.exp(k * off))
    mean_us = (up * on - (1 - up) * off) / drift
    n = len(events.t)
    expected = 100 * 5e6 / mean_us  # the first of a renewal comes at most one mean time late
    assert n == pytest.approx(expected, rel=0.02)
    assert events.p.mean() == pytest.approx(up, abs=4 * np.sqrt(up * (1 - up) / n))


def test_what_leaks_fires_on_events():
    """One each C / (leak + leak of light I)."""
    pixel = ForeignPixel(on=0.2, leak_per_us=1.05e-6, leak_of_light=4e-6, dark_light=0.3)
    events = steady(pixel, n_pixel=1, light=0.5)
    np.testing.assert_allclose(events.t, 0.2 / 3.05e-6 * np.arange(1, 31), atol=1.01)
    assert events.p.all()


def test_brownian_motion_is_rarer_in_bright_light_when_it_is_shot_noise():
    """A walk without drift leaves +-C after C^2 / sigma^2 on average, sigma = shot sqrt(I) / (I + dark)."""
    pixel = ForeignPixel(0.1, 0.1, walk_shot=3e-4, dark_light=0.1)
    for light in (0.2, 0.9):
        sigma = 3e-4 * np.sqrt(light) / (light + 0.1)
        assert len(steady(pixel, light=light, seconds=4).t) == pytest.approx(4e8 * sigma**2 / 0.01, rel=0.06)


@pytest.mark.parametrize("light, share", [(0.0, 1.0), (0.6, 0.7), (3.0, 0.5)])
def test_noise_events_are_poisson(light, share):
    """Their rate falls in a straight line to `noise_at_white`."""
    pixel = ForeignPixel(noise_on_hz=30, noise_off_hz=10, noise_at_white=0.5, dark_light=1e-9)
    events = steady(pixel, light=light, n_pixel=400)
    count = np.bincount(events.x, minlength=400)
    assert count.mean() == pytest.approx(80 * share, rel=0.02)
    assert count.var() == pytest.approx(count.mean(), rel=0.25)
    assert events.p.mean() == pytest.approx(0.75, abs=0.01)
    wait = np.diff(events.t[events.x == 7])
    assert wait.std() == pytest.approx(wait.mean(), rel=0.4)


def test_noise_rates_differ_from_pixel_to_pixel():
    pixel = ForeignPixel(noise_on_hz=500, noise_spread=0.5)
    count = np.bincount(steady(pixel, n_pixel=1000).x, minlength=1000)
    assert np.log(count).std() == pytest.approx(0.5, rel=0.1)
    assert count.mean() == pytest.approx(1000, rel=0.06)


def test_a_noise_event_resets_the_reference():
    """The event of the ramp that follows one of noise, OFF, comes a threshold above it."""
    x, p, t = ramp(ForeignPixel(on=0.2, noise_off_hz=40), n_pixel=300)
    order = np.lexsort((t, x))
    x, p, t = x[order], p[order], t[order]
    after_noise = np.flatnonzero((p[:-1] == 0) & (p[1:] == 1) & (x[:-1] == x[1:]))
    assert len(after_noise) > 100
    np.testing.assert_allclose(
        t[after_noise + 1], time_of(light_of(t[after_noise] + 0.5) * np.exp(0.2)), atol=3
    )


def test_a_noise_event_leaves_the_reference_where_it_is():
    x, p, t = ramp(ForeignPixel(on=0.2, noise_off_hz=40, noise_resets=False), n_pixel=300)
    assert (p == 0).sum() > 150
    for number in range(300):
        ideal = time_of(np.exp(0.2 * np.arange(1, 11)))
        np.testing.assert_allclose(t[(x == number) & (p == 1)], ideal, atol=1.01)


@pytest.mark.parametrize("uniform", [False, True])
def test_thresholds_from_event_to_event(uniform):
    x, p, t = ramp(ForeignPixel(on=0.2, event_noise=0.1, uniform=uniform), n_pixel=2000)
    order = np.lexsort((t, x))
    x, log_light = x[order], np.log(light_of(t[order] + 0.5))
    first = np.r_[True, x[1:] != x[:-1]]
    third = np.flatnonzero(first) + 2
    step = log_light[third] - log_light[third - 1]
    assert step.mean() == pytest.approx(0.2, rel=0.01)
    assert step.std() == pytest.approx(0.02, rel=0.06)
    assert (np.abs(step - 0.2).max() < 0.0353) == uniform  # 0.02 sqrt(3) and a clock


def test_thresholds_from_pixel_to_pixel():
    x, p, t = ramp(ForeignPixel(on=0.2, mismatch_on=0.03), n_pixel=2000)
    first = np.array([t[x == i][:2] for i in range(2000)])
    step = np.log(light_of(first + 0.5))
    assert step[:, 0].std() == pytest.approx(0.03, rel=0.06)
    np.testing.assert_allclose(step[:, 1], 2 * step[:, 0], atol=1e-3)


def test_latency_and_jitter_grow_in_the_dark():
    pixel = ForeignPixel(
        on=0.5, off=0.5, steps=True, latency_us=100, jitter_us=10, delay_doubles_at=np.e**0.5
    )
    _, _, ideal = ramp(ForeignPixel(on=0.5, steps=True))
    x, _, t = ramp(pixel, n_pixel=2000)
    first, second = (np.array([np.sort(t[x == i])[k] for i in range(2000)]) for k in (0, 1))
    assert (first - ideal[0]).mean() == pytest.approx(200, abs=2)  # at I = sqrt(e)
    assert (first - ideal[0]).std() == pytest.approx(20, rel=0.06)
    assert (second - ideal[1]).mean() == pytest.approx(100 * (1 + np.exp(-0.5)), abs=2)


def test_log_light_is_linear_between_frames():
    """Four frames of a slot: times by interpolation of the logarithm."""
    pixel = ForeignPixel(on=0.2, steps=True, frame_us=5000)
    _, _, t = ramp(pixel)
    frame = np.log(light_of(5000 * np.arange(5)))
    np.testing.assert_allclose(t, np.interp(0.2 * np.arange(1, 11), frame, 5000 * np.arange(5)), atol=1.01)


@pytest.mark.parametrize("clock_us", [10, 1000])
def test_clock(clock_us):
    """Times of events and triggers are the last tick."""
    signal = np.array([[[0.5, 1.5]], [[7.5, 0.1]], [[1.0, 3.0]]])
    fine, coarse = (
        watch(signal, 0.5, [0, 1, 2, -1], 4321.0, 0.7, 2, ForeignPixel(clock_us=clock))
        for clock in (1, clock_us)
    )
    assert len(fine.t) > 40
    np.testing.assert_array_equal(coarse.t, fine.t // clock_us * clock_us)
    np.testing.assert_array_equal(coarse.round_start_us, np.array([0, 17284, 34568]) // clock_us * clock_us)
    assert (coarse.x == fine.x).all() and (coarse.p == fine.p).all()


def test_read_out_makes_events_late_and_loses_them():
    """A bus of 10 us an event: of six at once the fourth waits 30 us."""
    t = np.array([0.0] * 6 + [100.0, 105.0, 200.0])
    np.testing.assert_allclose(read_out(t, 10.0, NEVER), [10, 20, 30, 40, 50, 60, 110, 120, 210])
    np.testing.assert_allclose(read_out(t, 10.0, 25.0), [10, 20, 30, NEVER, NEVER, NEVER, 110, 120, 210])
    free, busy = (ramp(ForeignPixel(per_event_us=e, patience_us=50), n_pixel=20)[2] for e in (0, 10))
    assert len(busy) == 6 / 20 * len(free)  # all pixels fire at once, and six of them wait 50 us at most


def test_light_follows_the_schedule():
    """Dark slots, an LED twice, hard switching: levels of steady light tell which LED is lit."""
    signal, order = np.array([[[1.0]], [[3.0]]]), [0, -1, 1, 1]
    pixel = ForeignPixel(0.01, 0.01, steps=True)
    events = watch(signal, 0.5, order, 1000.0, 0.0, 2, pixel)
    change = np.where(events.p == 1, 0.01, -0.01)
    for slot in range(1, 8):
        before_middle = events.t < 1000 * slot + 500
        light = np.log(0.5 + [1.0, 0.0, 3.0, 3.0][slot % 4])
        assert np.log(1.5) + change[before_middle].sum() == pytest.approx(light, abs=0.0101)


def test_no_change_of_light_gives_no_event():
    assert len(steady(ForeignPixel(0.02, 0.02, tau_us=50, latency_us=9)).t) == 0


def test_a_seed_gives_the_same_events_again():
    pixel = ForeignPixel(event_noise=0.1, tau_us=30, photons_per_us=50, noise_on_hz=5, jitter_us=20)
    one, same, other = (np.array(ramp(pixel, seed, n_pixel=5)[2]) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert len(one) != len(other) or (one != other).any()
    x, _, t = ramp(pixel, 1, n_pixel=5)
    assert not np.array_equal(t[x == 0], t[x == 1])
