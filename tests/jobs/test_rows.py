"""A table of jobs is read or refused in a sentence; a row counts as done only where its whole fit lies."""

import os
from dataclasses import replace

import pytest

from evsdr.errors import InputError
from evsdr.jobs.rows import Row, read_rows
from tests.support.page_fits import make_fit
from tests.support.saved_fits import save

HEADER = "scene,events,options,out\n"


def read(folder, text):
    (folder / "jobs.csv").write_text(text)
    return read_rows(folder / "jobs.csv")


def test_a_row_is_a_command(tmp_path):
    row, other = read(tmp_path, HEADER + "s.xml,a.h5,\"--preset fast -D 'name=a b'\",x\ns.xml,b/c.h5,,\n")
    assert row.words == ["s.xml", "a.h5", "--out", "x", "--preset", "fast", "-D", "name=a b"]
    assert other.words == ["s.xml", "b/c.h5", "--out", "b/c"]
    assert row.folder == tmp_path.resolve()
    assert read(tmp_path, "\ufeffevents,scene\nb/c.h5,s.xml\n") == [other]  # as a spreadsheet writes it


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("scene,event\ns,e\n", "its columns are scene, event"),
        (HEADER, "it has no rows"),
        (HEADER + "s.xml,,,\n", "line 2 has no scene or no events"),
        (HEADER + "s.xml,a.h5\n", "line 2 has not as many fields"),
        (HEADER + 's.xml,a.h5,"--x \'y",\n', "a quote in the options does not end"),
        (HEADER + "s.xml,a.h5,--out=z,\n", "use the column out"),
        (HEADER + "s.xml,a.h5,,o\ns.xml,b.h5,,./o\n", "lines 2 and 3 both write to ./o"),
        ("", "its columns are none"),
        ('"', "no readable table"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, sentence):
    with pytest.raises(InputError, match=r"jobs\.csv: .*\.$") as refused:
        read(tmp_path, text)
    assert sentence in str(refused.value)


def test_only_the_whole_fit_of_this_command_counts(tmp_path):
    row = Row(tmp_path, "s.xml", "a.h5", "--preset fast", "o")
    command = "python -m evsdr.fit s.xml a.h5 --out o --preset fast"
    fit = make_fit()

    def done(**told):
        save(row.results, replace(fit, summary=fit.summary | {"command": command} | told))
        return row.summary() is not None

    assert row.summary() is None
    assert done() and done(stopped=False)
    assert not done(command=command + " --seed 1")
    assert not done(stopped=True, stopped_by="SIGINT")
    assert done(stopped=True, stopped_by="time budget")
    (tmp_path / "a.h5").write_text("")
    os.utime(tmp_path / "a.h5", (2**32, 2**32))  # recorded anew
    assert row.summary() is None
    (tmp_path / "a.h5").unlink()
    assert row.summary()
    (row.results / "maps.npz").write_bytes(b"cut")
    assert row.summary() is None
