"""What is measured with a schedule, and without."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.viewing.look import look_at
from tests.support.watched_files import N_LED, recorded, watched


@pytest.mark.parametrize("triggers", [True, False])
def test_rounds_are_counted(triggers):
    recording = recorded(rounds=3)
    look = look_at(watched(recording, triggers))
    assert look.n_round == 3 and look.begin_us == 0
    assert look.per_slot.sum() == pytest.approx(len(recording.events), abs=2)
    assert not look.noisy


def test_without_schedule():
    look = look_at(replace(watched(recorded()), schedule=None))
    assert look.rounds is look.leds is look.flicker is look.per_slot is None
    assert look.period_us == pytest.approx(N_LED * 20_000, rel=2e-3)
    assert len(look.beat[0]) == len(look.beat[1]) > 100
    assert np.isfinite(look.beat[1]).all()
