"""A batch from the command line: results and a table, nothing twice, and sentences for what can't be."""

import csv
import sys

import pytest

from evsdr.commands.batch import Options, main, shares
from evsdr.jobs import engines, process


@pytest.fixture
def jobs(commands):
    path = commands.folder / "jobs.csv"
    words = "--preset fast --priors none --no-report"
    path.write_text(
        f"scene,events,options,out\nscene.xml,events.h5,{words} --truth truth.npz,a\nscene.xml,no.h5,,b\n"
    )
    return path


def table(path):
    return list(csv.DictReader(path.read_text().splitlines()))


@pytest.mark.slow
def test_rows_are_fitted_once(commands, jobs):
    status, out, err = commands.run(main, jobs)
    assert (status, err) == (1, "")
    assert "a: done, " in out and "b: refused, no.h5: there is no" in out
    done, refused = table(commands.folder / "jobs.results.csv")
    assert (done["state"], done["tries"], refused["state"]) == ("done", "1", "refused")
    assert 0 < float(done["mae_deg"]) < 10 and float(done["seconds"]) > 0
    jobs.write_text(jobs.read_text().partition("scene.xml,no.h5")[0])
    status, out, _ = commands.run(main, jobs, "--table", commands.folder / "t.csv")
    assert status == 0
    assert [row["state"] for row in table(commands.folder / "t.csv")] == ["done before"]


def test_what_never_ends_well_is_told(commands, jobs, monkeypatch):
    monkeypatch.setattr(process, "COMMAND", (sys.executable, "-c", "import os; os.abort()"))
    status, out, _ = commands.run(main, jobs)
    assert status == 1 and out.count("killed") == 3  # two rows and the table
    assert {row["tries"] for row in table(commands.folder / "jobs.results.csv")} == {"3"}


def test_threads_times_jobs_are_the_cores(monkeypatch):
    monkeypatch.setattr(engines, "cores", lambda: 16)
    assert shares(Options("j"), 100) == (8, 2)
    assert shares(Options("j"), 3) == (3, 5)
    assert shares(Options("j", at_once=4), 100) == (4, 4)
    assert shares(Options("j", threads=4), 100) == (4, 4)
    assert shares(Options("j", threads=32), 100) == (1, 32)
    assert shares(Options("j", executor="dask"), 3)[1] == 1


def test_what_cant_be_is_refused(commands, jobs):
    assert "absent.csv: there is no readable table" in commands.refused(main, commands.folder / "absent.csv")
    assert "give its --address" in commands.refused(main, jobs, "--executor", "dask")
    assert "--at-once is 0" in commands.refused(main, jobs, "--at-once", "0")
