"""What the commands share: exit status, sentences, tables and seconds per stage."""

import os
import shlex
import signal
import subprocess
import sys
import time
import warnings
from dataclasses import dataclass

import pytest

from evsdr.commands import console
from evsdr.commands.console import print_table, run_command
from evsdr.errors import InputError, InputWarning
from evsdr.files.atomic import atomic_folder
from tests.conftest import REPOSITORY


@dataclass(frozen=True)
class Options:
    """Count to a number."""

    number: int = 1
    """How far."""

    def __post_init__(self):
        if self.number < 0:
            raise InputError(f"number is {self.number}; give 0 or more.")


def test_a_command_that_works(capsys):
    seen = []
    assert run_command("count", Options, seen.append, ["--number", "3"]) == 0
    assert seen == [Options(3)]
    assert capsys.readouterr() == ("", "")


def test_a_command_that_gives_its_status():
    assert run_command("count", Options, lambda options: options.number, ["--number", "3"]) == 3


@pytest.mark.parametrize(
    "error, status, sentence",
    [
        (InputError("a: b; c."), 2, "error: a: b; c.\n"),
        (KeyboardInterrupt(), 130, "stopped; nothing was written.\n"),
    ],
)
def test_a_command_that_stops(capsys, error, status, sentence):
    def command(options):
        raise error

    assert run_command("count", Options, command, []) == status
    assert capsys.readouterr() == ("", sentence)


def test_options_that_check_themselves(capsys):
    assert run_command("count", Options, pytest.fail, ["--number", "-1"]) == 2
    assert capsys.readouterr() == ("", "error: number is -1; give 0 or more.\n")


def test_a_defect_is_told_in_a_sentence_that_names_a_log(capsys, tmp_path, monkeypatch):
    def command(options):
        raise ZeroDivisionError("of all things")

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert run_command("count", Options, command, ["--number", "3"]) == 70
    out, err = capsys.readouterr()
    (log,) = tmp_path.iterdir()
    told = (
        f"error: evsdr.count met what nobody had foreseen (ZeroDivisionError); please report it with {log}.\n"
    )
    assert (out, err) == ("", told)
    text = log.read_text()
    assert "count --number 3\n" in text and "Traceback" in text and "ZeroDivisionError: of all things" in text


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_what_compiled_code_makes_of_ctrl_c_is_no_defect(capsys):
    def command(options):
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(10)
        except KeyboardInterrupt:
            raise RuntimeError("callback failed") from None

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert run_command("count", Options, command, []) == 130
    finally:
        signal.signal(signal.SIGINT, before)
    assert capsys.readouterr() == ("", "stopped; nothing was written.\n")


def test_a_defect_on_a_full_disk_is_told_too(capsys, tmp_path, monkeypatch):
    def command(options):
        raise ZeroDivisionError

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    assert run_command("count", Options, command, []) == 70
    assert "no file can be written to tell of it" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name, status", [("SIGTERM", 143), ("SIGHUP", 129)])
def test_other_signals_stop_as_ctrl_c_does(capsys, tmp_path, name, status):
    number = getattr(signal, name)
    before = signal.signal(number, signal.SIG_DFL)
    try:

        def command(options):
            with atomic_folder(tmp_path / "out"):
                os.kill(os.getpid(), number)
                time.sleep(10)

        assert run_command("count", Options, command, []) == status
        assert signal.getsignal(number) is signal.SIG_DFL
        signal.signal(number, signal.SIG_IGN)
        assert run_command("count", Options, lambda _: os.kill(os.getpid(), number), []) == 0
    finally:
        signal.signal(number, before)
    assert capsys.readouterr().err == "stopped; nothing was written.\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("can't start new thread")])
def test_memory_that_runs_out_has_its_own_sentence(capsys, error):
    def command(options):
        raise error

    assert run_command("count", Options, command, []) == 70
    assert capsys.readouterr().err.startswith("error: the memory ran out; use a smaller film")


def test_a_reader_that_goes_away_is_no_defect(tmp_path):
    """As in `python -m evsdr.fit ... | head`."""
    program = (
        "from evsdr.commands.console import run_command\n"
        "from tests.commands.test_console import Options\n"
        "def command(options):\n    for k in range(10**6): print(k)\n"
        "raise SystemExit(run_command('count', Options, command, []))"
    )
    ended = subprocess.run(
        f"{sys.executable} -c {shlex.quote(program)} | head -1",
        cwd=REPOSITORY,
        shell=True,
        capture_output=True,
        text=True,
    )
    assert (ended.stdout, ended.stderr) == ("0\n", "")


def test_warnings_are_plain_sentences(capsys):
    def command(options):
        for _ in range(2):
            warnings.warn(InputWarning("a lacks b; c is taken."), stacklevel=1)

    shown, filters = warnings.showwarning, list(warnings.filters)
    assert run_command("count", Options, command, []) == 0
    assert capsys.readouterr() == ("", 2 * "warning: a lacks b; c is taken.\n")
    assert warnings.showwarning is shown and warnings.filters == filters


def test_help_names_the_command(capsys):
    with pytest.raises(SystemExit) as stop:
        run_command("count", Options, pytest.fail, ["--help"])
    assert stop.value.code == 0
    out, err = capsys.readouterr()
    assert out.startswith("usage: python -m evsdr.count ") and "Count to a number." in out and err == ""


def test_arguments_are_those_of_the_process(monkeypatch):
    seen = []
    monkeypatch.setattr(sys, "argv", ["count", "--number", "4"])
    assert run_command("count", Options, seen.append, None) == 0
    assert seen == [Options(4)]


def test_table_shows_brackets(capsys):
    print_table("a[/b] [bold]", [("time [s]", "1.5"), ("[red]", "[/]")])
    out, err = capsys.readouterr()
    assert err == ""
    assert all(text in out for text in ("a[/b] [bold]", "time [s]", "1.5", "[red]", "[/]"))


def test_a_title_stays_on_its_line(capsys):
    print_table("jobs.results.csv", [("done", "1")])
    assert capsys.readouterr().out.splitlines()[0].strip() == "jobs.results.csv"


@pytest.mark.parametrize("free", [1e8, 1e10])
def test_libraries_without_room_are_a_matter_of_memory(monkeypatch, free):
    monkeypatch.setattr(console, "free_memory", lambda: free)
    error = ImportError("failed to map segment from shared object")
    assert console._of_memory(error) == (free < 1e9)
