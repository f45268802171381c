"""The level of log light in each slot, and which LED gives none."""

import numpy as np
import pytest

from evsdr.viewing.leds import find_leds, levels, slot_counts
from evsdr.viewing.pixels import look_at_pixels
from evsdr.viewing.sample import take_sample
from tests.support.watched_files import CONSTANT_LIGHT, N_LED, PIXEL, ball_signal, recorded, watched


def sample_of(file):
    return take_sample(file.events, file.shape, look_at_pixels(file).hot)


@pytest.mark.parametrize("crossfade", [1.0, 0.6])
def test_levels_are_those_of_the_light(crossfade):
    recording = recorded(pixel=PIXEL.idealised(), crossfade=crossfade)
    sample = sample_of(watched(recording))
    found = levels(sample, recording.schedule, recording.round_start_us) * PIXEL.contrast_threshold_on
    log = np.log(ball_signal().reshape(N_LED, -1)[:, sample.place].T + CONSTANT_LIGHT)
    expected = log - log.mean(axis=1, keepdims=True)
    assert np.abs(found - expected).mean() < PIXEL.contrast_threshold_off / 2
    assert np.corrcoef(found.ravel(), expected.ravel())[0, 1] > 0.97


def test_events_of_each_slot():
    recording = recorded()
    counts = slot_counts(recording.events, recording.schedule, recording.round_start_us)
    slot = (recording.events.t // 20_000) % N_LED
    for p in (0, 1):
        expected = np.bincount(slot[recording.events.p == p], minlength=N_LED)
        np.testing.assert_array_equal(counts[p], expected)


def test_dead_leds_but_not_dark_slots():
    signal = ball_signal().copy()
    signal[[2, 9]] = 0
    recording = recorded(signal)
    sample = sample_of(watched(recording))
    assert find_leds(sample, recording.schedule, recording.round_start_us).dead == [2, 9]
    order = recording.schedule.order.copy()
    order[2] = -1
    told = watched(recording, order=order).schedule
    assert find_leds(sample, told, recording.round_start_us).dead == [9]


def test_less_than_a_round_tells_nothing():
    recording = recorded()
    sample = sample_of(watched(recording))
    assert find_leds(sample, watched(recording, slot_us=1e6).schedule, np.empty(0)) is None
