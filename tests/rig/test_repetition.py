"""After which time events come again."""

import numpy as np
import pytest

from evsdr.records import Events
from evsdr.rig.repetition import Repetition
from tests.support.camera_files import make_recording
from tests.support.watched_files import N_LED, recorded, watched

PERIOD_US = 96_000


def periodic(rng, n_round=4):
    """Events under eight LEDs, one after the other from left and right, that are alike in pairs."""
    rate = np.repeat(np.tile(rng.uniform(0.3, 1, 4), 2), 12) * np.tile(np.hanning(12), 8)
    k = np.tile(np.repeat(np.arange(96), (60 * rate).astype(int)), n_round)
    t = (
        1000 * k
        + np.repeat(np.arange(n_round) * PERIOD_US, len(k) // n_round)
        + rng.integers(0, 1000, len(k))
    )
    order = np.argsort(t)
    x = np.where(k < 48, rng.integers(0, 40, len(k)), rng.integers(24, 64, len(k)))
    return make_recording(x[order], rng.integers(0, 48, len(k)), rng.integers(0, 2, len(k)), t[order])


def repetition(camera):
    return Repetition(camera.events, (camera.height, camera.width))


def test_the_round_is_found(rng):
    assert repetition(periodic(rng)).shortest()[0] == pytest.approx(PERIOD_US, rel=0.01)
    zeros = np.zeros(5000, int)
    flat = make_recording(zeros, zeros, zeros, np.sort(rng.integers(0, 400_000, 5000)))
    assert repetition(flat).shortest() == (0.0, 0.0)
    assert repetition(make_recording([1, 2], [1, 2], [0, 1], [0, 1])).shortest() == (0.0, 0.0)


def test_the_period_is_that_of_the_ring():
    file = watched(recorded())
    repetition = Repetition(file.events, file.shape)
    period, strength = repetition.shortest()
    assert period == pytest.approx(N_LED * 20_000, rel=2e-3)
    assert repetition.after(period) == pytest.approx(strength, rel=0.1) and strength > 0.3
    assert repetition.after(0.4 * period) < 0.5 * strength
    assert np.isnan(repetition.after(100 * period))


def test_events_at_random_never_come_again(rng):
    events = recorded().events
    order = rng.permutation(len(events))
    t = np.sort(rng.integers(0, events.t[-1], len(events)))
    events = Events(events.x[order], events.y[order], events.p[order], t)
    assert Repetition(events, (20, 20)).shortest() == (0.0, 0.0)
