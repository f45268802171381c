"""Seconds of stages, and a bar for terminals alone."""

import io
import sys
import time

import pytest

from evsdr.progress import Seconds, Stages


def test_seconds_of_stages():
    with Stages("count") as stages:
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


def test_seconds_of_a_stage_that_fails():
    with pytest.raises(RuntimeError), Stages("count") as stages, stages.stage("one"):
        raise RuntimeError
    assert list(stages.seconds) == ["one"]


def run_stages():
    with Stages("count") as stages, stages.stage("first") as advance:
        advance("a detail", 0.5)
        stages._progress.refresh()  # else it is drawn ten times a second


def test_progress_goes_to_standard_error_of_a_terminal(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Terminal())
    run_stages()
    assert "count: first, a detail" in sys.stderr.getvalue()


def test_no_progress_without_a_terminal(capsys):
    run_stages()
    assert capsys.readouterr() == ("", "")
