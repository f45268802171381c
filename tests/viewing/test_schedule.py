"""How far events come again, and with which schedule they go."""

import numpy as np
import pytest

from evsdr.records import Events
from evsdr.viewing.pixels import look_at_pixels
from evsdr.viewing.rounds import find_triggers
from evsdr.viewing.sample import take_sample
from evsdr.viewing.schedule import Repetition, fit_schedule
from tests.support.watched_files import N_LED, recorded, watched


def fitted(file):
    pixels = look_at_pixels(file)
    sample = take_sample(file.events, file.shape, pixels.hot)
    return fit_schedule(file.schedule, find_triggers(file.edges), sample, Repetition(file.events, file.shape))


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
    events = Events(events.x[order], events.y[order], events.p[order], events.t)
    assert Repetition(events, (20, 20)).shortest() == (0.0, 0.0)


def test_a_schedule_that_fits_is_believed():
    found = fitted(watched(recorded()))
    assert not found.wrong and found.late_us == 0
    assert found.coherence > 0.97 and found.told > 0.9
    assert len(found.starts) == 5


def test_triggers_tell_the_length_of_slots():
    found = fitted(watched(recorded(), slot_us=21_000.0))
    assert found.wrong
    assert found.schedule.slot_us == pytest.approx(20_000, rel=1e-4)
    np.testing.assert_array_equal(found.starts, N_LED * 20_000 * np.arange(5))


@pytest.mark.parametrize("start_us", [-7_000.0, 213_000.0])
def test_a_start_in_the_midst_of_a_slot(start_us):
    assert fitted(watched(recorded(), False, start_us=start_us)).late_us != 0
