"""A row runs in a process of its own, with its threads, and tells how it ended."""

import sys

import pytest

from evsdr.jobs import process
from evsdr.jobs.process import Ended, Fitting, fit_row
from evsdr.jobs.rows import Row


@pytest.fixture
def fake(monkeypatch):
    """Put a few lines of Python in place of the fit."""
    return lambda text: monkeypatch.setattr(process, "COMMAND", (sys.executable, "-c", text))


def test_it_is_told_the_row_and_its_threads(tmp_path, fake):
    fake(
        "import os, sys; print(os.getcwd(), os.environ['EVSDR_THREADS'], *sys.argv[1:], file=sys.stderr); sys.exit(3)"
    )
    ended = fit_row(Row(tmp_path, "s.xml", "a.h5", "--seed 1", "o"), 5)
    assert ended == Ended(3, f"{tmp_path} 5 s.xml a.h5 --out o --seed 1")


def test_one_that_is_cancelled_is_killed(tmp_path, fake):
    fake("import time; time.sleep(60)")
    running = Fitting(Row(tmp_path, "s.xml", "a.h5", "", "o"), 1)
    assert not running.done()
    running.cancel()
    assert running.done() and running.process.returncode == -9


def test_it_is_the_fit_of_this_package(tmp_path):
    ended = fit_row(Row(tmp_path, "absent.xml", "absent.h5", "--no-report", "o"), 1)
    assert ended.status == 2 and ended.said.startswith("error: absent.h5: there is no")
