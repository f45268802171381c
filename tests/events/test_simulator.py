"""Event pixels against a brute-force twin, closed forms, and the law of event pairs."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.events import simulator
from evsdr.events.phase import weights
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import draw_pattern, find_crossings, simulate_events
from tests.support import event_reference
from tests.support.pixel_light import CUTOFF, STEP_US, column, log_light, ring, run

IDEAL = EventPixel.ideal(0.2, 20.0)


@pytest.mark.parametrize(
    "crossfade, change, led_rise_us",
    [
        (1.0, {}, 0),
        (0.3, {}, 0),
        (0.0, {}, 0),
        (1.0, {"refractory_us": 0.0, "contrast_threshold_off": 0.31}, 0),
        (0.3, {"refractory_us": 52.5, "contrast_threshold_off": 0.31}, 0),
        (0.0, {}, 30),
        (0.3, {}, 30),
        (1.0, {"cutoff_hz": 3000}, 0),
        (0.3, {"cutoff_hz": 3000}, 0),
        (0.0, {"cutoff_hz": 30_000}, 0),
        (0.3, {"leak_hz": 1000}, 0),
        (0.0, {"leak_hz": 1000}, 0),
        (0.3, {"leak_hz": 500, "cutoff_hz": 10_000}, 20),
    ],
)
def test_brute_force_twin(crossfade, change, led_rise_us):
    """Five LEDs and a dark slot, from nearly dark to bright, two rounds.

    Times agree to 0.02 us (the twin's step for hard switches), or where the light hardly changes any more,
    to 0.0003 in log intensity.
    """
    order, slot_us, n_round, constant_light = [0, 2, -1, 1, 4, 3], 300.0, 2, 0.04
    signal = np.random.default_rng(2).random((5, 6)) ** 3
    pixel = replace(IDEAL, **change)
    schedule = ring(order, slot_us, crossfade)
    index, polarity, t_us = run(signal[:, None], constant_light, schedule, n_round, pixel, 0, led_rise_us)

    grid = np.arange(0, n_round * len(order) * slot_us, STEP_US)
    light = event_reference.light_path(grid, signal, constant_light, order, slot_us, crossfade, led_rise_us)
    jumps = crossfade == 0 and led_rise_us == 0
    path = np.log(light)
    if pixel.cutoff_hz:
        path = event_reference.lagged_path(grid, light, pixel.cutoff_hz, jumps)
    on, off = np.float32(pixel.contrast_threshold_on), np.float32(pixel.contrast_threshold_off)
    leak = pixel.leak_hz * 1e-6 * on
    n_event = 0
    for i in range(signal.shape[1]):
        times, polarities = event_reference.find_events(grid, path[:, i], on, off, pixel.refractory_us, leak)
        np.testing.assert_array_equal(polarity[index == i], polarities)
        late = np.abs(t_us[index == i] - times)
        moved = np.abs(np.interp(t_us[index == i], grid, path[:, i]) - np.interp(times, grid, path[:, i]))
        assert ((late < (STEP_US if jumps else 0.02)) | (moved < 3e-4)).all()
        n_event += len(times)
    assert n_event > 50
    assert {1, -1} == set(polarity)


@pytest.mark.parametrize("refractory_us", [0.0, 52.0])
@pytest.mark.parametrize("crossfade", [0.3, 1.0])
def test_pair_law(crossfade, refractory_us, rng):
    """log I(t_k) - log I(t_(k-1) + refractory) = p_k C: exactly, and with rounded times to their rounding."""
    signal = rng.random((6, 8, 9)).astype(np.float32)
    schedule = ring([0, 1, 2, -1, 3, 4, 5], 400.0, crossfade, start_us=1000.0)
    pixel = replace(EventPixel.ideal(0.2, refractory_us), contrast_threshold_off=0.3, spread_on=0.03)
    fixed = draw_pattern(pixel, 8, 9, 5)
    found = find_crossings(signal, 0.05, schedule, 3, pixel, fixed)
    events, on, off, _ = simulate_events(signal, 0.05, schedule, 3, pixel, seed=5)
    np.testing.assert_array_equal(on, fixed.threshold_on)
    np.testing.assert_array_equal(off, np.float32(0.3))

    def misfit(pixel_index, polarity, t):
        second = np.flatnonzero(np.diff(pixel_index) == 0) + 1
        here = pixel_index[second]
        threshold = np.where(polarity[second] > 0, on.ravel()[here], off.ravel()[here])
        misfit, half_us = -polarity[second] * threshold.astype(np.float64), 0.0
        for sign, at in ((-1, t[second - 1] + refractory_us), (1, t[second])):
            low, middle, high = (log_light(at + d, here, signal, 0.05, schedule) for d in (-0.5, 0, 0.5))
            misfit += sign * middle
            half_us += np.maximum(np.abs(middle - low), np.abs(high - middle))
        return misfit, half_us

    exact, _ = misfit(found.pixel, found.polarity, found.t_us + 1000.0)
    assert len(exact) > 1000
    assert np.abs(exact).max() < 1e-9

    order = np.lexsort((events.t, events.y * 9 + events.x))
    index = (events.y.astype(np.int64) * 9 + events.x)[order]
    rounded, bound = misfit(index, 2 * events.p[order] - 1, events.t[order].astype(np.float64))
    assert (np.abs(rounded) <= bound).all() and len(rounded) == len(exact)
    assert np.abs(rounded).max() > 1e-4


@pytest.mark.parametrize(
    "pixel",
    [EventPixel.ideal(0.02, 0.0), EventPixel(leak_hz=0, hot_fraction=0, photon_rate_per_us=0)],
    ids=["ideal", "real without leak and shot noise"],
)
def test_constant_light_gives_no_event(pixel, rng):
    """A dark ring, one LED after itself, and LEDs that all shine alike."""
    signal = np.repeat(rng.random((1, 5, 4)), 3, axis=0)
    for order, constant_light in (([-1, -1], 0.1), ([-1], 0.0), ([2, 2], 0.0), ([0, 1, 2], 0.3)):
        for crossfade in (0.0, 0.4, 1.0):
            schedule = ring(order, crossfade=crossfade)
            assert len(simulate_events(signal, constant_light, schedule, 2, pixel, led_rise_us=5.0)[0]) == 0
            assert len(simulate_events(signal, constant_light, schedule, 2, pixel)[0]) == 0


def test_hard_switch_fires_once():
    """Without lag a switch is a jump: one event at that instant, however large, also without refractory."""
    for refractory_us in (0.0, 52.0):
        _, polarity, t_us = run(
            column(1.0, 0.01), 0.01, ring([0, 1], crossfade=0.0), 3, EventPixel.ideal(0.25, refractory_us)
        )
        np.testing.assert_array_equal(t_us, 300.0 * np.arange(1, 6))
        np.testing.assert_array_equal(polarity, [-1, 1, -1, 1, -1])


def test_darkness_is_finite():
    """From darkness (taken as 1e-6) up to 1 and back, by 13 events of 1.0 and 13 / 1.1 events of 1.1."""
    pixel = replace(EventPixel.ideal(1.0, 0.0), contrast_threshold_off=1.1)
    _, polarity, t_us = run(column(1.0), 0.0, ring([-1, 0], 1000.0), 1, pixel)
    np.testing.assert_array_equal(polarity, [1] * 13 + [-1] * 11)
    expected = 1000 * 1e-6 * np.expm1(np.arange(1, 14)) / (1 - 1e-6)
    np.testing.assert_allclose(t_us[:13], expected, rtol=1e-9)


def test_rise_time_closed_form():
    """I = I1 + (I0 - I1) exp(-t / rise) after a hard switch from 0.1 to 1."""
    _, _, t_us = run(
        column(0.1, 1.0), 0.0, ring([0, 1], 1000.0, 0.0), 1, EventPixel.ideal(0.5, 0.0), led_rise_us=40.0
    )
    light = 0.1 * np.exp(0.5 * np.arange(1, 5))
    np.testing.assert_allclose(t_us, 1000 - 40 * np.log((1 - light) / 0.9), rtol=0, atol=1e-3)


@pytest.mark.parametrize("light", [0.05, 1.0])
def test_step_response_of_the_photoreceptor(light):
    """A switch by 40 %: v = log I1 + (log I0 - log I1) exp(-t / tau), tau = 53 us at I = 1."""
    pixel = replace(EventPixel.ideal(0.1, 0.0), cutoff_hz=3000)
    _, _, t_us = run(column(light / 1.4, light), 0.0, ring([0, 1], 10_000.0, 0.0), 1, pixel)
    n = np.arange(1, 4)
    expected = 10_000 - np.log(1 - n * np.float32(0.1) / np.log(1.4)) / (CUTOFF * light)
    np.testing.assert_allclose(t_us, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("light, latency_us", [(1.0, 53.1), (0.08, 663.0)])
def test_latency(light, latency_us):
    """On a slow ramp the photoreceptor lags by tau of the light there: 53 us when bright, 663 us when dim."""
    signal, schedule = column(0.8 * light, 1.2 * light), ring([0, 1], 100_000.0)
    lagging = replace(EventPixel.ideal(float(np.log(1 / 0.8)), 0.0), cutoff_hz=3000)
    instant = replace(lagging, cutoff_hz=0)
    late = run(signal, 0.0, schedule, 1, lagging)[2][0] - run(signal, 0.0, schedule, 1, instant)[2][0]
    assert late == pytest.approx(latency_us, rel=0.01)


def test_events_of_a_30_fold_change():
    """log 30 = 13.47 x 0.2525: 13 events when slow, fewer when the 52 us of each event count.

    A jump fires once, behind the photoreceptor 3 to 8 times. An event costs 52 us of slope, so even ramps of
    0.5 s and 5 ms fire 13 and 10 times, log ramps of 20 and 5 ms 13 and 11 times.
    """
    ideal = EventPixel.ideal(0.2525)
    for pixel, n_event in ((ideal, {1}), (replace(ideal, cutoff_hz=3000), set(range(3, 9)))):
        jump = run(column(1 / 30, 1.0), 0.0, ring([0, 1], 100_000.0, 0.0), 1, pixel)
        assert len(jump[1]) in n_event
    for ramp_us, n_event in ((500_000.0, 13), (5000.0, 10)):
        _, polarity, t_us = run(column(1 / 30, 1.0), 0.0, ring([0, 1], ramp_us), 1, ideal)
        assert np.sum(t_us < ramp_us) == n_event and (polarity[:n_event] == 1).all()
        light = 1 / 30
        for _ in range(n_event):
            light = light * np.exp(0.2525) + 52 * (29 / 30) / ramp_us
        assert light < 1 < light * np.exp(0.2525)
    n_led = 65
    signal = column(*30 ** (np.arange(n_led) / (n_led - 1) - 1))
    for ramp_us, n_event in ((20_000.0, 13), (5000.0, 11)):
        _, _, t_us = run(signal, 0.0, ring(range(n_led), ramp_us / (n_led - 1)), 1, ideal)
        lost = 52 * np.log(30) / ramp_us
        assert np.sum(t_us < ramp_us) == n_event == np.floor((np.log(30) + lost) / (0.2525 + lost))


@pytest.fixture(scope="module")
def ring_of_real_pixels():
    """A small ring before real pixels, that fire about 40 times each."""
    signal = np.random.default_rng(3).random((6, 9, 7)).astype(np.float32)
    return dict(
        signal=signal, constant_light=0.05, schedule=ring(range(6), 2000.0, 0.6, start_us=500.0), n_round=2,
        pixel=EventPixel(hot_fraction=0.05), led_rise_us=5.0,
    )  # fmt: skip


def as_table(events):
    return np.stack([events.t, events.y, events.x, events.p])


def test_same_seed_same_events(ring_of_real_pixels, monkeypatch):
    """One thread or several, in blocks and buffers of any size; another seed differs."""
    expected = as_table(simulate_events(**ring_of_real_pixels, seed=4)[0])
    assert expected.shape[1] > 1000
    n_thread = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        np.testing.assert_array_equal(as_table(simulate_events(**ring_of_real_pixels, seed=4)[0]), expected)
    finally:
        numba.set_num_threads(n_thread)
    other = as_table(simulate_events(**ring_of_real_pixels, seed=5)[0])
    assert other.shape != expected.shape or (other != expected).any()
    monkeypatch.setattr(simulator, "BLOCK", 10)
    monkeypatch.setattr(simulator, "ROOM", 30)
    calls = []
    events, *_ = simulate_events(**ring_of_real_pixels, seed=4, progress=lambda *call: calls.append(call))
    np.testing.assert_array_equal(as_table(events), expected)
    assert calls == [(10, 63), (20, 63), (30, 63), (40, 63), (50, 63), (60, 63), (63, 63)]


def test_noise_of_pixels_is_independent():
    """All pixels see the same; none repeats another's times, and noise does not correlate between them."""
    signal = np.broadcast_to(column(0.2, 1.0), (2, 30, 30))
    pixel = replace(EventPixel(), spread_on=0, spread_off=0, leak_hz=0, hot_fraction=0)
    index, _, t_us = run(signal, 0.0, ring([0, 1], 50_000.0), 1, pixel)
    assert len(np.unique(t_us)) == len(t_us)
    first = t_us[np.unique(index, return_index=True)[1]]
    assert len(first) == 900
    assert abs(np.corrcoef(first[1:], first[:-1])[0, 1]) < 0.15


def test_what_comes_out(ring_of_real_pixels):
    """Sorted by time, then row, then column; types; polarities; round starts."""
    events, on, off, round_start_us = simulate_events(**ring_of_real_pixels, seed=4)
    types = [a.dtype for a in (events.x, events.y, events.p, events.t, on, off, round_start_us)]
    assert types == [np.uint16, np.uint16, np.int8, np.int64, np.float32, np.float32, np.int64]
    np.testing.assert_array_equal(round_start_us, [500, 12_500, 24_500])
    order = np.lexsort((events.x, events.y, events.t))
    np.testing.assert_array_equal(order, np.arange(len(events)))
    assert set(events.p) == {0, 1} and events.x.max() == 6 and events.y.max() == 8
    assert 500 <= events.t.min() and events.t.max() <= 24_500


def test_where_it_comes_out():
    """Only the pixel at row 2, column 5 changes: up, then down; times count from start_us, rounded."""
    signal = np.full((2, 4, 8), 0.5)
    signal[1, 2, 5] = 1.0
    schedule = ring([0, 1], 1000.0, 1.0, start_us=10_000.4)
    events, _, _, round_start_us = simulate_events(signal, 0.0, schedule, 1, EventPixel.ideal(0.5, 10.0))
    up = 10_000.4 + 1000 * (np.exp(0.5) - 1)
    down = 10_000.4 + 2000 - 1000 * (2 * np.exp(-0.5) * light_at(up + 10, schedule) - 1)
    np.testing.assert_array_equal(as_table(events), [[round(up), round(down)], [2, 2], [5, 5], [1, 0]])
    np.testing.assert_array_equal(round_start_us, [10_000, 12_000])


def light_at(t, schedule):
    return 0.5 + 0.5 * weights(np.array([t]), schedule, 2, np.empty(0, np.int64))[0, 1]


@pytest.mark.parametrize(
    "change, field",
    [
        ({"signal": np.zeros((3, 4))}, "signal"),
        ({"signal": column(0.1, -0.1)}, "signal"),
        ({"signal": column(0.1, np.nan)}, "signal"),
        ({"constant_light": -0.1}, "constant_light"),
        ({"schedule": ring([0, 2])}, "order"),
        ({"schedule": ring([-2, 0])}, "order"),
        ({"schedule": ring([])}, "order"),
        ({"schedule": ring([0], slot_us=0.0)}, "slot_us"),
        ({"schedule": ring([0], crossfade=1.1)}, "crossfade"),
        ({"schedule": ring([0], start_us=np.nan)}, "start_us"),
        ({"n_round": 0}, "n_round"),
        ({"seed": -1}, "seed"),
        ({"led_rise_us": -1.0}, "led_rise_us"),
    ],
)
def test_arguments_that_make_no_sense(change, field):
    arguments = dict(signal=column(0.1, 1), constant_light=0.1, schedule=ring([0, 1]), n_round=1, pixel=IDEAL)
    with pytest.raises(InputError, match=f"^{field} "):
        simulate_events(**(arguments | change))


def test_the_unit_of_light_makes_no_difference():
    """Without a photoreceptor events tell ratios of light."""
    arguments = dict(schedule=ring([0, 1, -1]), n_round=2, pixel=IDEAL)
    light = column(0.5, 2)
    (expected, *_), (found, *_) = (
        simulate_events(signal=light * unit, constant_light=0.05 * unit, **arguments)
        for unit in (1, 2.0**-40)
    )
    assert len(expected) > 10
    for name in "xypt":
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    silent, *_ = simulate_events(signal=0 * light, constant_light=0.0, **arguments)
    assert len(silent) == 0
