"""Steps of the clock, slots of another length, and times that are late."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.effects import clock
from evsdr.effects.clock import ClockStep, SlotLength, TimeShift, step_of
from evsdr.events.period import Period
from evsdr.records import Events
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


def test_a_shift_that_noise_can_make_is_no_warning():
    """Noise fires events early, by what is not known better than that."""
    shared = found(shift=0.2)
    assert TimeShift().warning(shared)
    assert not TimeShift().warning(replace(shared, inferred=replace(shared.inferred, lead=0.08)))


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


def with_times(t, starts=(0, 3000)):
    """Give a world whose pixels (0, 0) and (1, 0) take turns at times t [us]."""
    n = len(t)
    events = Events(
        np.arange(n, dtype=np.uint16) % 2, np.zeros(n, np.uint16), np.ones(n, np.int8), np.asarray(t)
    )
    before = world()
    return replace(
        before, recording=replace(before.recording, events=events, round_start_us=np.asarray(starts))
    )


def test_events_come_in_the_middle_of_their_step(rng):
    """On average; where they are in it does not shift them any more."""
    exact = np.sort(rng.integers(0, 500_000, 400))
    before = with_times(exact // 100 * 100)
    chosen = ClockStep().decide("auto", before, None)
    assert chosen.modelled and chosen.found == {"step_us": 100} and "100 us" in chosen.why
    assert ClockStep().model(before, chosen).clock_us == 100
    after = ClockStep().model(before, chosen).recording
    late = np.sort(after.events.t) - exact
    assert abs(late.mean()) < 4 and np.abs(late).max() <= 100
    assert (np.diff(after.events.t) >= 0).all()
    np.testing.assert_array_equal(after.round_start_us, [0, 3000])


def test_events_of_one_pixel_share_a_step():
    """Two of one pixel stand at its quarters, in their order, those of others in the middle; coordinates go along."""
    t = np.repeat(np.arange(50) * 200, 4)[:-1]
    before = with_times(t)
    found = ClockStep().model(before, ClockStep().decide("auto", before, None)).recording.events
    np.testing.assert_array_equal(found.t[found.x == 0], (np.arange(50)[:, None] * 200 + [50, 150]).ravel())
    np.testing.assert_array_equal(found.t[found.x == 1][-3:], [9650, 9750, 9900])
    assert (np.diff(found.t) >= 0).all()


@pytest.mark.parametrize(
    ("starts", "later"), [((0, 3000, 6100), 50), ((0, 3000, 6000), 0), ((7, 3010, 6020), 0)]
)
def test_triggers_in_steps_of_the_clock(starts, later):
    """Rounds that last no whole steps, by a clock of their own; by the ring's; to the microsecond."""
    before = with_times(np.arange(400) * 100, starts)
    after = ClockStep().model(before, ClockStep().decide("auto", before, None)).recording
    np.testing.assert_array_equal(after.round_start_us, np.add(starts, later))


@pytest.mark.parametrize(
    "t",
    [
        np.arange(400) * 100 + (np.arange(400) == 9),
        np.arange(99) * 100,
        np.arange(400) * 1000,
        np.zeros(0, int),
    ],
)
def test_no_step_of_a_clock(t):
    """One event off it; too few events; only when slots start; none."""
    assert ClockStep().decide("auto", with_times(t), None) is None
    assert step_of(t) in (0, 1, 1000)
