"""Event pixels against a brute-force twin, closed forms, and the law of event pairs."""

from dataclasses import replace

import numba
import numpy as np
import pytest

import event_reference
from evsdr import event_pixel
from evsdr.errors import InputError
from evsdr.event_pixel import EventPixel, draw_pattern, find_crossings, simulate_events
from evsdr.records import Schedule
from evsdr.ring_light import weights

STEP_US = 0.25
CUTOFF = 2e-6 * np.pi * 3000  # 1 / tau at I = 1 and 3 kHz [1/us]


def ring(order, slot_us=300.0, crossfade=1.0, start_us=0.0) -> Schedule:
    return Schedule(np.array(order, np.int32), slot_us, crossfade, start_us)


def column(*signal) -> np.ndarray:
    """One pixel under LEDs of these signals, (n_led, 1, 1)."""
    return np.array(signal, np.float64)[:, None, None]


def run(signal, constant_light, schedule, n_round, pixel, seed=0, led_rise_us=0.0):
    """Exact times and polarities, pixel after pixel: (index, polarity, time) of each event."""
    fixed = draw_pattern(pixel, *signal.shape[1:], seed)
    found = find_crossings(signal, constant_light, schedule, n_round, pixel, fixed, led_rise_us)
    return found.pixel, found.polarity, found.t_us


IDEAL = EventPixel.ideal(0.2, 20.0)


@pytest.mark.parametrize(
    "crossfade, change, led_rise_us, tolerance_us",
    [
        (1.0, {}, 0, STEP_US),
        (0.3, {}, 0, STEP_US),
        (0.0, {}, 0, STEP_US),
        (1.0, {"refractory_us": 0.0}, 0, STEP_US),
        (0.3, {"contrast_threshold_off": 0.31, "refractory_us": 52.5}, 0, STEP_US),
        (0.0, {}, 30, STEP_US),
        (0.3, {}, 30, STEP_US),
        (1.0, {"cutoff_hz": 3000}, 0, 2 * STEP_US),
        (0.3, {"cutoff_hz": 3000}, 0, 2 * STEP_US),
        (0.0, {"cutoff_hz": 30_000}, 0, 2 * STEP_US),
        (0.3, {"leak_hz": 1000}, 0, STEP_US),
        (0.0, {"leak_hz": 1000}, 0, STEP_US),
        (0.3, {"leak_hz": 500, "cutoff_hz": 10_000}, 20, 2 * STEP_US),
    ],
)
def test_brute_force_twin(crossfade, change, led_rise_us, tolerance_us):
    """Five LEDs and a dark slot, from nearly dark to bright, two rounds; steps of 0.25 us in the twin."""
    order, slot_us, n_round, constant_light = [0, 2, -1, 1, 4, 3], 300.0, 2, 0.04
    signal = np.random.default_rng(2).random((5, 6)) ** 3
    pixel = replace(IDEAL, **change)
    schedule = ring(order, slot_us, crossfade)
    index, polarity, t_us = run(signal[:, None], constant_light, schedule, n_round, pixel, 0, led_rise_us)

    grid = np.arange(0, n_round * len(order) * slot_us + STEP_US, STEP_US)
    light = event_reference.light_path(grid, signal, constant_light, order, slot_us, crossfade, led_rise_us)
    path = event_reference.lagged_path(grid, light, pixel.cutoff_hz) if pixel.cutoff_hz else np.log(light)
    on, off = np.float32(pixel.contrast_threshold_on), np.float32(pixel.contrast_threshold_off)
    leak = pixel.leak_hz * 1e-6 * on
    n_event = 0
    for i in range(signal.shape[1]):
        times, polarities = event_reference.find_events(grid, path[:, i], on, off, pixel.refractory_us, leak)
        np.testing.assert_array_equal(polarity[index == i], polarities)
        np.testing.assert_allclose(t_us[index == i], times, rtol=0, atol=tolerance_us)
        n_event += len(times)
    assert n_event > 60
    assert {1, -1} == set(polarity)
