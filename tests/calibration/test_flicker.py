"""The ring's own flicker: its depth in each pixel, and what fires in the dark."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.calibration.flicker import duty, is_flicker, read_flicker
from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.events.record import FLICKER_ROUNDS, FLICKER_US, flicker_order, record, ring_schedule
from evsdr.records import Events

LIGHT, SIGNAL = 0.06, np.random.default_rng(0).uniform(0.3, 1, (1, 6, 8))


def flicker(pixel, signal=SIGNAL, light=LIGHT):
    """Record a flicker by pixels that see an LED each its own way."""
    return record(
        signal, light, pixel, ring_schedule(1, flicker_order((0,)), FLICKER_US), FLICKER_ROUNDS, seed=1
    )


def test_duty_follows_the_carriers():
    schedule = ring_schedule(3, flicker_order((-1, 2)))
    assert is_flicker(schedule) and not is_flicker(ring_schedule(3))
    np.testing.assert_allclose(duty(np.array([0, 0.25, 1, 1.5, 2, 2.75]), schedule), [1, 0.75, 0, 0, 0, 0.75])


@pytest.mark.parametrize(
    ("pixel", "within"), [(EventPixel().idealised(), 0.03), (EventPixel(hot_fraction=0), 0.2)]
)
def test_depth_is_found_in_each_pixel(pixel, within):
    found = read_flicker(flicker(pixel))
    np.testing.assert_allclose(found.veil, LIGHT / SIGNAL.ravel(), rtol=within)
    assert np.mean(found.dark_hz) < 1 and not found.mains


def test_hot_pixels_and_lamps_show_in_the_dark(rng):
    recording = flicker(EventPixel().idealised())
    e, end = recording.events, recording.events.t[-1]
    hot = np.arange(0, end, 10_000)
    lamp = rng.integers(0, end // 10_000, 2000) * 10_000 + rng.integers(0, 2000, 2000)
    t = np.concatenate([e.t, hot, lamp])
    order = np.argsort(t, kind="stable")
    x = np.concatenate([e.x, np.full(len(hot), 3), rng.integers(0, 8, 2000)])[order]
    y = np.concatenate([e.y, np.full(len(hot), 2), rng.integers(0, 6, 2000)])[order]
    p = np.concatenate([e.p, np.ones(len(hot), int), rng.integers(0, 2, 2000)])[order]
    events = Events(x.astype(np.uint16), y.astype(np.uint16), p.astype(np.int8), t[order])
    found = read_flicker(replace(recording, events=events))
    assert np.flatnonzero(found.dark_hz > 50).tolist() == [2 * 8 + 3]
    assert list(found.mains) == [100.0] and found.mains[100.0] > 0.8


def test_what_does_not_flicker_enough_is_refused():
    recording = flicker(EventPixel().idealised())
    first = recording.events.t < 2 * FLICKER_US
    events = Events(*(getattr(recording.events, name)[first] for name in "xypt"))
    with pytest.raises(InputError, match="no pixel has enough events of the fading LED"):
        read_flicker(replace(recording, events=events))
