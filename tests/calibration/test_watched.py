"""Pixels that a calibration watches, with their events."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.calibration.watched import watch
from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.events.record import record, ring_schedule

MASK = np.ones((5, 6), bool)
MASK[0] = False
POINT = np.arange(30).reshape(5, 6)


def recorded(crossfade=1.0):
    images = np.broadcast_to(np.reshape([0.9, 0.2, 0.6], (3, 1, 1)), (3, 5, 6))
    return record(
        images, 0.1, EventPixel(spread_on=0.02), ring_schedule(3, (0, -1, 1, 2), crossfade=crossfade), 2
    )


def test_pixels_come_with_their_points_thresholds_and_events():
    recording = recorded()
    part = watch(recording, MASK, POINT, 10**6, 0)
    np.testing.assert_array_equal(part.number, np.flatnonzero(MASK))
    np.testing.assert_array_equal(part.point, part.number)
    on = recording.sensor.contrast_threshold_on.ravel()[part.number]
    np.testing.assert_allclose(part.threshold[:, 0], on)
    assert not part.own_thresholds and part.refractory_us == recording.sensor.refractory_us
    where = recording.events.y.astype(int) * 6 + recording.events.x
    np.testing.assert_array_equal(
        np.bincount(part.pixel_of_event, minlength=30), np.bincount(where, minlength=30) * MASK.ravel()
    )


def test_one_value_for_all_thresholds_leaves_each_unknown():
    recording = recorded()
    sensor = replace(recording.sensor, contrast_threshold_on=0.25, contrast_threshold_off=0.38)
    part = watch(replace(recording, sensor=sensor), MASK, POINT, 10**6, 0)
    assert part.own_thresholds and set(part.threshold[:, 1]) == {0.38}


def test_whole_pixels_are_drawn_where_events_are_many():
    recording = recorded()
    few, again, other = (watch(recording, MASK, POINT, 100, seed) for seed in (0, 0, 1))
    assert len(few.events[1]) <= 100 < len(watch(recording, MASK, POINT, 10**6, 0).events[1])
    np.testing.assert_array_equal(few.number, again.number)
    assert set(few.number) != set(other.number)
    assert len(watch(recording, MASK, POINT, 1, 0).number) == 1


def test_hard_switches_tell_no_exact_change():
    with pytest.raises(InputError, match="crossfade is 0, .* after a hard switch"):
        watch(recorded(crossfade=0.0), MASK, POINT, 100, 0)


def test_pixels_without_events_are_refused():
    recording = recorded()
    nothing = replace(
        recording, events=type(recording.events)(*(getattr(recording.events, k)[:0] for k in "xypt"))
    )
    with pytest.raises(InputError, match="no two events of a pixel follow each other"):
        watch(nothing, MASK, POINT, 100, 0)
