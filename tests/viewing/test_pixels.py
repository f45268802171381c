"""Pixels that are hot, silent, or too slow."""

from dataclasses import replace

import numpy as np

from evsdr.records import Events
from evsdr.viewing.pixels import look_at_pixels
from tests.support.watched_files import PIXEL, recorded, watched


def test_hot_and_silent_pixels():
    recording = recorded()
    events = recording.events
    kept = ~((events.x == 9) & (events.y == 8))
    t = np.arange(events.t[0], events.t[-1], 1_000)  # a pixel that fires a thousand times a second
    parts = (
        (events.x[kept], np.full(len(t), 4)),
        (events.y[kept], np.full(len(t), 13)),
        (events.p[kept], np.ones(len(t), np.int8)),
        (events.t[kept], t),
    )
    x, y, p, when = (np.concatenate(part) for part in parts)
    order = np.argsort(when, kind="stable")
    events = Events(x[order], y[order], p[order], when[order])
    found = look_at_pixels(watched(replace(recording, events=events)))
    np.testing.assert_array_equal(np.argwhere(found.hot), [[13, 4]])
    np.testing.assert_array_equal(np.argwhere(found.silent), [[8, 9]])
    assert (found.on + found.off).sum() == len(events)
    assert not found.saturated.any()


def test_a_dark_line_is_no_fault_of_the_pixels():
    recording = recorded()
    events = recording.events
    kept = ~((events.x == 9) & (events.y > 4) & (events.y < 14))
    events = Events(*(getattr(events, name)[kept] for name in ("x", "y", "p", "t")))
    assert not look_at_pixels(watched(replace(recording, events=events))).silent.any()


def test_slow_pixels_are_saturated():
    found = look_at_pixels(watched(recorded(slot_us=4_000.0, pixel=replace(PIXEL, refractory_us=2_000.0))))
    assert np.count_nonzero(found.saturated) > 0.2 * np.count_nonzero(found.lit)
    assert found.shortest_us > 2_000
