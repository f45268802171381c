"""How far events come again, and with which schedule they go."""

import numpy as np
import pytest

from evsdr.rig.repetition import Repetition
from evsdr.viewing.pixels import look_at_pixels
from evsdr.viewing.rounds import find_triggers
from evsdr.viewing.sample import take_sample
from evsdr.viewing.schedule import fit_schedule
from tests.support.watched_files import N_LED, recorded, watched


def fitted(file):
    pixels = look_at_pixels(file)
    sample = take_sample(file.events, file.shape, pixels.hot)
    return fit_schedule(file.schedule, find_triggers(file.edges), sample, Repetition(file.events, file.shape))


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
