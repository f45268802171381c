"""Which crossfade all that pixels share explains best, and when that convicts the told one."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects import crossfade
from evsdr.effects.crossfade import (
    WORTH,
    beside,
    fading,
    find_crossfade,
    may_switch,
    most_likely,
    share_at_starts,
)
from evsdr.effects.world import Terms
from evsdr.records import Events, Recording, Schedule, Sensor

ROUND_US = 50_000


@dataclass(frozen=True)
class World:
    recording: Recording
    terms: Terms = Terms()


class Parabola:
    """Log evidence of an event that falls from `best`, faster below."""

    def __init__(self, best, vain=False, doubted=False):
        self.best, self.vain, self.doubted, self.found = best, vain, doubted, {}

    def __call__(self, value):
        slope = 8.0 if value < self.best else 4.0
        return self.found.setdefault(value, -slope * abs(value - self.best))

    def ask_from(self, other, value):
        self.asked = other, value

    def in_vain(self, value):
        return self.vain

    def doubts_powers(self, value):
        return self.doubted and abs(value - self.best) < 0.05


def recording_of(t, told=1.0):
    some, schedule = np.zeros(len(t), np.uint16), Schedule(np.array([0, 1, 2, -1, 3], np.int32), 1e4, told)
    events = Events(some, some, some.astype(np.int8), np.sort(t).astype(int))
    return Recording(events, Sensor(5, 5, 0.3, 0.3, 50.0), schedule, np.array([0, ROUND_US]))


def found(monkeypatch, evidence, told, n_pixel=40, t=()):
    """What is found with such evidence."""
    monkeypatch.setattr(crossfade, "choose", lambda *_: np.arange(n_pixel))
    monkeypatch.setattr(crossfade, "Evidence", lambda *_: evidence)
    fitted = SimpleNamespace(problem=None, solution=None)
    return find_crossfade(World(recording_of(np.array(t), told)), fitted)


@pytest.mark.parametrize(
    ("best", "told", "likely"),
    [(0.3, 1.0, 0.3), (0.63, 0.0, 0.63), (0.02, 1.0, 0.0), (0.95, 0.3, 1.0), (0.05, 0.0, 0.05)],
)
def test_the_best_is_sought_but_rings_switch_or_fade_all_along(best, told, likely):
    assert most_likely(Parabola(best), told) == pytest.approx(likely, abs=0.01)


@pytest.mark.parametrize(
    ("best", "told", "asked"),
    [(0.3, 1.0, 0.0), (0.63, 0.0, 1.0), (0.63, 1.0, None), (0.3, 0.0, None), (0.0, 1.0, None)],
)
def test_what_rings_do_is_asked_once_more_from_the_best(best, told, asked):
    evidence = Parabola(best)
    evidence.asked = None
    likely = most_likely(evidence, told)
    assert evidence.asked == (None if asked is None else (likely, asked))


def test_where_all_is_in_vain_what_is_told_stands():
    assert most_likely(Parabola(0.3, vain=True), 1.0) == 1.0


@pytest.mark.parametrize(
    ("told", "evidence", "n_pixel", "convicts"),
    [
        (1.0, Parabola(0.3), 40, True),
        (1.0, Parabola(0.3), 19, False),
        (0.3, Parabola(0.3), 40, False),
        (0.3 + 1.1 * WORTH / 4, Parabola(0.3), 40, True),
        (0.3 + 0.9 * WORTH / 4, Parabola(0.3), 40, False),
        (0.3 + 1.1 * WORTH / 4, Parabola(0.3, doubted=True), 40, False),
        (0.3 + 2.2 * WORTH / 4, Parabola(0.3, doubted=True), 40, True),
        (1.0, Parabola(0.3, vain=True), 40, False),
    ],
)
def test_evidence_that_convicts(monkeypatch, told, evidence, n_pixel, convicts):
    """Where powers are known by hardly anything but the files, twice as much."""
    finding = found(monkeypatch, evidence, told, n_pixel)
    assert bool(finding) == convicts
    assert not convicts or ("within 0.3 of a slot" in str(finding) and "times as likely" in str(finding))


@pytest.mark.parametrize(("t", "n_tried"), [((), 2), (np.arange(200) % 5 * 10_000 + 2000, 10)])
def test_no_more_is_tried_where_no_other_beside_is_better_but_times_are_of_switches(monkeypatch, t, n_tried):
    evidence = Parabola(1.0)
    assert found(monkeypatch, evidence, 1.0, t=t) is None
    assert (len(evidence.found) == n_tried) == (n_tried == 2) and len(evidence.found) >= n_tried


def test_evidence_is_of_an_event_and_remembered_and_takes_what_passes_for_another_fade(monkeypatch):
    """Whatever the user leaves out."""
    searched = []

    def asked_of(world, fitted, row):
        searched.append((world.recording.schedule.crossfade, world.terms.shared))
        found = SimpleNamespace(surprise=-30.0, in_vain=True, doubted=("powers",))
        return SimpleNamespace(
            search=lambda names, start: found, names=(), pixels=SimpleNamespace(n_event=10)
        )

    monkeypatch.setattr(crossfade, "asked_of", asked_of)
    world = World(recording_of(np.arange(3)), Terms(shared=("directions",)))
    evidence = crossfade.Evidence(world, None, np.arange(3))
    assert evidence(0.25) == evidence(0.25) == 3.0 and evidence.in_vain(0.25) and evidence.doubts_powers(0.25)
    ((value, names),) = searched
    assert value == 0.25 and {"lag", "shift", "thresholds"} <= set(names) and "directions" not in names


@pytest.mark.parametrize(("again", "stands"), [(-50.0, 5.0), (-10.0, 3.0)])
def test_a_search_from_where_another_ended_stands_if_it_is_less_of_a_surprise(monkeypatch, again, stands):
    def search(names, start):
        assert start in (None, -30.0)
        return SimpleNamespace(surprise=-30.0 if start is None else again)

    asked = SimpleNamespace(search=search, names=(), pixels=SimpleNamespace(n_event=10))
    monkeypatch.setattr(crossfade, "asked_of", lambda *_: asked)
    monkeypatch.setattr(crossfade, "start_from", lambda found: found.surprise)
    evidence = crossfade.Evidence(World(recording_of(np.arange(3))), None, np.arange(3))
    evidence.ask_from(0.1, 0.0)
    assert (evidence(0.1), evidence(0.0)) == (3.0, stands)


def test_beside_what_is_told():
    assert beside(1.0) == (0.75, 1.0) and beside(0.4) == pytest.approx((0.3, 0.532))
    assert len(set(beside(0.0))) == 2 and min(beside(0.0)) > 0


def test_a_crossfade_in_words_and_how_it_is_mended():
    assert (
        fading(0.0).what == "the LEDs switch without fading"
        and fading(1.0).what == "the LEDs fade into each other"
    )
    quarter = fading(0.25)
    assert quarter.what == "the LEDs fade within 0.25 of a slot" and "crossfade = 0.25 " in quarter.remedy
    assert quarter.mend(World(recording_of(np.arange(3)))).recording.schedule.crossfade == 0.25


@pytest.mark.parametrize(("late", "share"), [(0, 1.0), (5, 0.95), (15, 0.85), (100, 0.0)])
def test_times_of_events_hint_that_leds_switch(late, share):
    """Not under LEDs that are told to fade at the end of slots, nor do few; outside of the rounds they mean nothing."""
    inside = np.arange(100) // 20 * 10_000 + np.where(np.arange(100) < late, 7000, 2000)
    recording = recording_of(np.append(inside, 77_000))
    assert share_at_starts(recording) == pytest.approx(share) and may_switch(recording) == (share > 0.9)
    assert not may_switch(recording_of(inside, 0.4))
    assert (
        share_at_starts(recording_of(inside[1:])) == 0 and share_at_starts(recording_of(inside + 60_000)) == 0
    )
