"""The order of events in a recording."""

import numpy as np
import pytest

from evsdr.events import simulator
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import draw_pattern, find_crossings
from evsdr.events.sorting import sort_events
from tests.support.pixel_light import ring


@pytest.mark.parametrize("start_us", [0.0, 1234.5, -7.25])
@pytest.mark.parametrize("duration_us", [1.0, 50.0, 3e6, 2.0**40])
def test_order_is_stable(duration_us, start_us, rng):
    """By rounded time, then as they came."""
    pixel = np.sort(rng.integers(0, 35, 1000))
    polarity = rng.choice(np.array([-1, 1], np.int8), 1000)
    t_us = duration_us * rng.random(1000)
    x, y, p, t = sort_events(pixel, polarity, t_us, start_us, 7)
    rounded = np.rint(t_us + start_us)
    order = np.argsort(rounded, kind="stable")
    np.testing.assert_array_equal(t, rounded[order])
    np.testing.assert_array_equal(7 * y.astype(int) + x, pixel[order])
    np.testing.assert_array_equal(2 * p - 1, polarity[order])
    assert [a.dtype for a in (x, y, p, t)] == [np.uint16, np.uint16, np.int8, np.int64]


def test_no_event():
    none = np.empty(0, np.int64), np.empty(0, np.int8), np.empty(0)
    assert [len(a) for a in sort_events(*none, 0.0, 5)] == [0, 0, 0, 0]


def test_events_come_pixel_by_pixel(monkeypatch):
    """Those of pixels that had to be run again for room, too; the order of events at the same time rests on it."""
    monkeypatch.setattr(simulator, "ROOM", 30)
    signal = np.random.default_rng(3).random((6, 1, 60)) ** 3
    pixel = EventPixel()
    found = find_crossings(signal, 0.05, ring(range(6), 2000.0), 2, pixel, draw_pattern(pixel, 1, 60, 0))
    index = found.pixel
    count = np.bincount(index, minlength=60)
    assert count.min() < 30 < count.max() and (np.diff(index) >= 0).all()
