"""Seconds of stages; one bar on a terminal, lines elsewhere."""

import io
import sys
import time

import pytest

from evsdr import progress
from evsdr.progress import Plan, Seconds, Stages, Whole, time_left


def test_seconds_of_stages():
    with Stages("count", ("one", "two")) as stages:
        with stages.stage("one") as advance:
            advance("half", 0.5)
            time.sleep(0.01)
        with stages.stage("two"):
            pass
    assert list(stages.seconds) == ["one", "two"]
    assert stages.seconds["one"] >= 0.01 and stages.seconds["two"] >= 0


def test_who_is_told_may_ask_to_end_soon():
    asked = []
    stages = Seconds(lambda stage, share: asked.append(share) or share == 0.5)
    with stages.stage("one") as advance:
        assert not advance("a", 0.1) and not stages.enough
        assert advance("b", 0.5) and advance("c", 0.7) and stages.enough


def test_who_has_nothing_new_to_tell_may_ask_all_the_same():
    told = []
    stages = Seconds(lambda stage, share: told.append((stage, share)) or len(told) > 3)
    with stages.stage("one") as advance:
        advance("a", 0.1)
        assert not stages.ask() and stages.ask() and stages.enough
    assert told[1:] == [("one, a", 0.1)] * 3


def test_seconds_of_a_stage_that_fails():
    with pytest.raises(RuntimeError), Stages("count", ("one",)) as stages, stages.stage("one"):
        raise RuntimeError
    assert list(stages.seconds) == ["one"]


def run_stages():
    with Stages("count", ("zero", "first", "last")) as stages, stages.stage("first") as advance:
        advance("a detail", 0.5)
        stages._progress.refresh()  # else it is drawn ten times a second


def test_one_bar_for_all_stages_on_standard_error_of_a_terminal(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Terminal())
    run_stages()
    shown = sys.stderr.getvalue()
    assert "count: first, a detail" in shown and " 50%" in shown


def test_no_bar_without_a_terminal(capsys):
    run_stages()
    assert capsys.readouterr() == ("", "")


def test_lines_without_a_terminal(capsys, monkeypatch):
    clock = iter([0.0, *range(7, 100, 7)])
    monkeypatch.setattr(progress.time, "monotonic", lambda: float(next(clock)))
    with Stages("count", ("first", "last")) as stages, stages.stage("first") as advance:
        for k in range(6):  # the first line comes at 21 s, the next at 42 s
            advance("a detail", k / 6)
    out, err = capsys.readouterr()
    assert out == ""
    assert err == (
        "count: 8%, first, a detail, about 4 min left\ncount: 33%, first, a detail, about 84 s left\n"
    )


# ---- the share of the whole ------------------------------------------------------------------------------


PLAN = Plan({"read": 1.0, "solve": 8.0, "write": 1.0}, {"descent": 2.0, "draws": 4.0})


def test_the_whole_grows_by_stages_and_their_parts():
    whole = Whole(PLAN)
    assert whole.told("read", 0.0) == 0
    assert whole.told("read", 0.5) == pytest.approx(0.05)
    assert whole.told("solve", 0.0) == pytest.approx(0.1)
    assert whole.told("solve, descent", 0.5) == pytest.approx(0.2)
    assert whole.told("solve, draws", 0.5) == pytest.approx(
        0.5
    )  # the descent ended before its steps were used up
    assert whole.told("solve, descent", 0.1) > 0.7
    assert whole.told("write", 0.0) == pytest.approx(0.9)


def test_it_never_falls_nor_comes_to_an_end_too_early():
    whole, shares = Whole(PLAN), []
    for round_ in range(20):  # far more than was foreseen
        for share in (0.5, 1.0):
            shares.append(whole.told("solve, draws", share))
            shares.append(whole.told("solve, what nobody has foreseen", share))
            shares.append(whole.told("a stage of its own", share))
    assert shares == sorted(shares)
    assert 0.85 < shares[-1] <= 0.9
    assert whole.told("read", 0.1) == shares[-1]


def test_without_parts_details_tell_the_share_of_their_stage():
    assert Whole(Plan({"a": 1.0, "b": 1.0})).told("a, detail", 0.5) == 0.25


@pytest.mark.parametrize(
    "elapsed, share, said",
    [
        (1.0, 0.5, ""),
        (10.0, 0.01, ""),
        (10.0, 0.5, "about 10 s left"),
        (100.0, 0.25, "about 5 min left"),
        (9.0, 1.0, ""),
    ],
)
def test_the_time_left(elapsed, share, said):
    assert time_left(elapsed, share) == said
