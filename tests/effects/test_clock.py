"""Times that are late."""

import numpy as np
import pytest

from evsdr.effects.clock import TimeShift
from evsdr.effects.shared import MODEL_US
from evsdr.errors import InputWarning
from tests.support.shared_worlds import decision, found, world


def test_a_shift_in_words_and_numbers():
    shared = found(shift=0.05)
    assert TimeShift().say(shared) == "events are 50 +- 14 us late"
    assert TimeShift().numbers(shared) == pytest.approx(
        {"shift_us": 50, "shift_sigma_us": np.hypot(10, MODEL_US)}
    )


def test_rounds_start_later():
    before = world()
    after = TimeShift().model(before, decision(TimeShift(), shift=0.05)).recording
    assert after.schedule.start_us == pytest.approx(57)
    np.testing.assert_allclose(after.round_start_us, [50, 3050])
    assert before.recording.round_start_us.tolist() == [0, 3000]


@pytest.mark.parametrize("shift", [0.1, -0.1])
def test_a_large_shift_is_warned_of(shift):
    """100 us, beyond three times 30."""
    with pytest.warns(InputWarning, match="^mine: events are -?100 us late against the triggers or start_us"):
        TimeShift().model(world(), decision(TimeShift(), shift=shift))
