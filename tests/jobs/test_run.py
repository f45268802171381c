"""Rows run some at a time; one that is killed runs again; one table tells of all."""

import csv

import pytest

from evsdr.jobs.process import Ended
from evsdr.jobs.rows import Row
from evsdr.jobs.run import TRIES, run_rows, write_table
from tests.support.page_fits import make_fit
from tests.support.saved_fits import save


class Fake:
    """An engine in which rows end at the second look, as told for each try; 0 leaves results."""

    def __init__(self, statuses):
        self.statuses = {row: list(told) for row, told in statuses.items()}
        self.running, self.most, self.cancelled = 0, 0, 0

    def __call__(self, row):
        self.running += 1
        self.most = max(self.most, self.running)
        return Future(self, row, self.statuses[row].pop(0))


class Future:
    def __init__(self, engine, row, status):
        self.engine, self.row, self.status, self.looks = engine, row, status, 0

    def done(self):
        self.looks += 1
        return self.looks > 1

    def result(self):
        self.engine.running -= 1
        if self.status == "lost":
            raise OSError("the worker\nis gone")
        if self.status == 0:
            save_row(self.row)
        return Ended(self.status, "error: no light." if self.status == 2 else "")

    def cancel(self):
        self.engine.cancelled += 1


def save_row(row):
    fit = make_fit()
    command = f"python -m evsdr.fit {row.scene} {row.events} --out {row.out}"
    save(
        row.results,
        type(fit)(fit.maps, fit.signals, fit.depth, fit.truth, fit.summary | {"command": command}),
    )


def rows(folder, n):
    return [Row(folder, "s.xml", f"{k}.h5", "", f"{k}") for k in range(n)]


def test_each_row_ends_as_it_should(tmp_path):
    given = rows(tmp_path, 5)
    save_row(given[4])
    engine = Fake(dict(zip(given, ([0], [-9, "lost", 0], [2], [-9] * TRIES), strict=False)))
    told = []
    outcomes = run_rows(given, engine, 2, told.append)
    assert [(o.state, o.tries) for o in outcomes] == [
        ("done", 1),
        ("done", 3),
        ("refused", 1),
        ("killed", TRIES),
        ("done before", 0),
    ]
    assert engine.most == 2
    assert sorted(told, key=lambda o: o.out) == outcomes
    write_table(tmp_path / "t.csv", outcomes)
    table = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert [line["said"] for line in table] == ["", "", "no light.", "", ""]
    assert table[1]["mae_deg"] == "1.25" and table[1]["known"] == "0.9167"
    assert table[2]["mae_deg"] == ""


def test_a_stop_ends_what_runs(tmp_path):
    given = rows(tmp_path, 3)
    engine = Fake({row: [0] for row in given})

    def stop(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_rows(given, engine, 2, stop)
    assert engine.cancelled == 1
