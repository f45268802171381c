"""A recording of the ring: what it tells of its pixels, its schedule and its rounds."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.events.record import record, ring_schedule
from evsdr.events.simulator import simulate_events

SIGNAL = np.array([0.8, 0.1, 0.4])[:, None, None] * np.ones((3, 2, 3))
PIXEL = replace(EventPixel().idealised(), spread_on=0.02, spread_off=0.02)


def test_a_ring_goes_round_in_order_unless_told_otherwise():
    plain, told = ring_schedule(3), ring_schedule(3, (2, -1), 500.0, 0.25)
    assert (plain.order.tolist(), plain.slot_us, plain.crossfade) == ([0, 1, 2], 20_000, 1)
    assert (told.order.tolist(), told.slot_us, told.crossfade) == ([2, -1], 500, 0.25)
    assert plain.order.dtype == np.int32


def test_trim_dims_leds():
    factor = np.array([0.25, 1, 0], np.float32)
    trimmed = record(SIGNAL, 0.1, PIXEL, ring_schedule(3, trim=factor), 2)
    dimmed = record(SIGNAL * factor[:, None, None], 0.1, PIXEL, ring_schedule(3), 2)
    np.testing.assert_array_equal(trimmed.events.t, dimmed.events.t)
    assert trimmed.schedule.trim.tolist() == factor.tolist()
    with pytest.raises(InputError, match="trim must hold 3 numbers"):
        record(SIGNAL, 0.1, PIXEL, ring_schedule(3, trim=factor[:2]), 2)


def test_events_and_thresholds_are_the_simulators():
    schedule = ring_schedule(3)
    events, on, off, starts = simulate_events(SIGNAL, 0.1, schedule, 2, PIXEL, seed=4, led_rise_us=30.0)
    recording = record(SIGNAL, 0.1, PIXEL, schedule, 2, seed=4, led_rise_us=30.0)
    np.testing.assert_array_equal(recording.events.t, events.t)
    np.testing.assert_array_equal(recording.round_start_us, starts)
    np.testing.assert_array_equal(recording.sensor.contrast_threshold_on, on)
    np.testing.assert_array_equal(recording.sensor.contrast_threshold_off, off)
    assert (recording.sensor.width, recording.sensor.height, recording.sensor.refractory_us) == (3, 2, 52)
    assert recording.schedule is schedule


@pytest.mark.parametrize(("pixel", "told"), [(PIXEL, "nominal"), (PIXEL.idealised(), "calibrated")])
def test_one_value_where_pixels_are_alike_or_are_not_told_apart(pixel, told):
    sensor = record(SIGNAL, 0.1, pixel, ring_schedule(3), 1, thresholds=told).sensor
    assert sensor.contrast_threshold_on == pixel.contrast_threshold_on
    assert sensor.contrast_threshold_off == pixel.contrast_threshold_off


def test_progress_and_what_can_not_be():
    told = []
    record(SIGNAL, 0.1, PIXEL, ring_schedule(3), 1, progress=lambda *now: told.append(now))
    assert told == [("", 1.0)]
    with pytest.raises(InputError, match="order must list LEDs 0 to 2"):
        record(SIGNAL, 0.1, PIXEL, ring_schedule(3, (0, 3)), 1)
