"""Times that are late."""

import numpy as np
import pytest

from evsdr.effects.clock import TimeShift
from tests.support.shared_worlds import FITTED, decision, found, world


def test_a_shift_in_words_and_numbers():
    shared = found(shift=0.05)
    assert TimeShift().say(shared) == "events are 50 +- 10 us late"
    assert TimeShift().numbers(shared) == pytest.approx({"shift_us": 50, "shift_sigma_us": 10})


def test_rounds_start_later():
    before = world()
    after = TimeShift().model(before, decision(TimeShift(), shift=0.05)).recording
    assert after.schedule.start_us == pytest.approx(57)
    np.testing.assert_allclose(after.round_start_us, [50, 3050])
    assert before.recording.round_start_us.tolist() == [0, 3000]


@pytest.mark.parametrize(("shift", "warned"), [(0.1, True), (-0.1, True), (0.08, False)])
def test_a_large_shift_is_warned_of(shift, warned):
    """100 us, beyond three times 30."""
    sentence = TimeShift().warning(found(shift=shift))
    assert sentence.startswith(f"events are {1000 * shift:g} us late against the triggers") == warned
    assert bool(sentence) == warned


def test_a_shift_is_not_told_without_a_lag():
    known = found(shift=0.1, names=("powers", "refractory"))
    chosen = TimeShift().decide("auto", world(known=known), FITTED)
    assert not chosen.modelled and chosen.why == "as told: light without a lag does not tell it"
