"""Which events count, and the clock of the ring."""

import numpy as np

from evsdr.events.phase import position
from evsdr.preview.window import clock, take_window
from tests.support.preview_ball import ball_light, ball_recording
from tests.support.watched_files import N_LED

ROUND_US = 20_000 * N_LED


def test_events_of_the_last_round():
    recording, mask = ball_recording(), ball_light().mask
    end = 2.5 * ROUND_US
    window = take_window(recording, end, 1.0, mask)
    events = recording.events
    inside = (events.t >= end - ROUND_US) & (events.t < end) & mask[events.y, events.x]
    np.testing.assert_array_equal(np.sort(window.t), events.t[inside])
    assert window.clock == (2 * ROUND_US, 20_000)


def test_the_clock_is_that_of_the_phase():
    schedule = ball_recording().schedule
    starts = np.array([100, 100 + 1.01 * ROUND_US, 100 + 2.02 * ROUND_US])
    begin, slot_us = clock(schedule, starts, starts[-1])
    t = np.array([starts[-1] - 12_345.0])
    assert np.isclose((t - begin) / slot_us % N_LED, position(t, schedule, starts)[0])


def test_triggers_that_are_no_round_apart_tell_no_slots():
    schedule = ball_recording().schedule
    assert clock(schedule, np.array([0, 1.5 * ROUND_US]), 2 * ROUND_US) == (1.5 * ROUND_US, 20_000)
    assert clock(schedule, np.empty(0), 2 * ROUND_US) == (schedule.start_us, 20_000)
