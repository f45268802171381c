"""Slots of another length, and times that are late."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.effects import clock
from evsdr.effects.clock import SlotLength, TimeShift
from evsdr.events.period import Period
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


def by(monkeypatch, period, starts):
    """Decide where the events tell a period, and triggers some starts of rounds of 3000 us."""
    monkeypatch.setattr(clock, "find_period", lambda recording: period)
    before = world()
    before = replace(before, recording=replace(before.recording, round_start_us=np.asarray(starts)))
    return before, SlotLength().decide("auto", before, None)


@pytest.mark.parametrize(("off", "modelled"), [(1e-3, True), (-1e-3, True), (2e-4, False)])
def test_slots_last_as_the_events_repeat(monkeypatch, off, modelled):
    before, chosen = by(monkeypatch, Period(1 + off, 1e-4), [])
    assert chosen.modelled == modelled and not chosen.warning
    assert f"{1e6 * off:+.0f} +- 1e+02 ppm" in chosen.why
    assert chosen.found["clock_ppm"] == pytest.approx(1e6 * off)
    assert SlotLength().model(before, chosen).recording.schedule.slot_us == pytest.approx(1000 * (1 + off))


def test_events_that_do_not_tell_leave_slots_as_told(monkeypatch):
    _, chosen = by(monkeypatch, None, [40])
    assert not chosen.modelled and chosen.why.startswith("as told: the events do not tell it")
    _, chosen = by(monkeypatch, Period(1.015, 1e-4), [])
    assert chosen.warning.startswith("rounds last 1.0150 times what slot_us says")


def test_triggers_count_and_their_clock_is_told(monkeypatch):
    """Rounds that are 0.1 % long, and each 1 us longer than the one before; one trigger is missing."""
    starts = np.cumsum(np.r_[70, 3003 + np.arange(20)])
    _, chosen = by(monkeypatch, Period(0.5, 1e-4), np.delete(starts, 7))
    assert not chosen.modelled
    assert chosen.found["clock_ppm"] == pytest.approx(1000 + 1e6 * 9.5 / 3000, rel=0.05)
    assert chosen.found["drift_ppm"] == pytest.approx(1e6 * 19 / 3000, rel=0.1)


@pytest.mark.parametrize("period", [Period(1.001, 1e-5), None])
def test_triggers_that_jitter_are_evened_out(monkeypatch, period):
    late = np.tile([150, -150, 0], 20)
    before, chosen = by(monkeypatch, period, 900 + 3003 * np.arange(60) + late)
    assert chosen.modelled and chosen.warning.startswith("triggers jitter by 1")
    np.testing.assert_allclose(
        SlotLength().model(before, chosen).recording.round_start_us, 900 + 3003 * np.arange(60), atol=10
    )
