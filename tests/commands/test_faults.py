"""Faults while a fit runs: signals, a full disk, limits of memory, a killed process. Results are whole or not there."""

import os
import resource
import signal
import subprocess
import sys
import time

import pytest

import evsdr
from evsdr.commands import fit
from evsdr.files import atomic
from evsdr.progress import Stages
from tests.conftest import REPOSITORY

FRESH = {n: signal.default_int_handler if n == signal.SIGINT else signal.SIG_DFL for n in (2, 15, 1, 14)}


@pytest.fixture(autouse=True)
def handlers():
    """Handlers as a fresh process has them, even if the parent of the tests ignores some."""
    before = {number: signal.signal(number, handler) for number, handler in FRESH.items()}
    yield
    assert {number: signal.getsignal(number) for number in FRESH} == FRESH
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def at_stage(monkeypatch):
    """Give a callable (stage, what): it lets `what` happen once, as soon as a stage of that name begins."""
    real = Stages.show

    def arrange(stage, what):
        left = [what]

        def show(self, name, share):
            real(self, name, share)
            if left and name.startswith(stage):
                left.pop()()

        monkeypatch.setattr(Stages, "show", show)

    return arrange


def send(*numbers):
    for number in numbers:
        os.kill(os.getpid(), number)
        time.sleep(0.05)


@pytest.fixture(scope="module")
def found(recorded):
    """A fit, to be written."""
    return evsdr.fit(recorded / "scene.xml", recorded / "events.h5", evsdr.Settings(preset="fast", shared=()))


def untouched(commands):
    """Check that the results of an earlier run are all there is."""
    folder = commands.folder / "out"
    assert [path.name for path in folder.iterdir()] == ["maps.npz"]
    assert (folder / "maps.npz").read_text() == "an earlier run"


@pytest.mark.parametrize("stage", ["start", "load scene", "trace light", "check recording"])
def test_ctrl_c_before_the_solver_writes_nothing(commands, at_stage, stage):
    at_stage(stage, lambda: send(signal.SIGINT))
    assert commands.fit() == (130, "", "stopped; nothing was written.\n")
    untouched(commands)


@pytest.mark.parametrize(
    ("stage", "name"),
    [("solve", "SIGINT"), ("neighbours", "SIGTERM"), ("settle light", "SIGHUP"), ("surface", "SIGINT")],
)
def test_a_stop_while_the_solver_runs_keeps_the_best_so_far(commands, at_stage, stage, name):
    at_stage(stage, lambda: send(getattr(signal, name)))
    status, out, err = commands.fit()
    assert (status, out) == (128 + getattr(signal, name), "")
    maps, summary = evsdr.read_results(commands.folder / "out")
    whole = stage == "surface"
    assert summary["stopped"] == (not whole) and maps.mask.any()
    assert err.splitlines()[-1].startswith(
        f"stopped; {'the whole fit' if whole else 'the best so far'} is in "
    )
    assert whole or "stopped early" in summary["verdict"]


def test_a_second_ctrl_c_ends_at_once(commands, at_stage):
    at_stage("solve, descent", lambda: send(signal.SIGINT, signal.SIGINT))
    assert commands.fit() == (130, "", "stopped; nothing was written.\n")
    untouched(commands)


@pytest.mark.parametrize("n_byte", [0, 300, 1000, 3000, 10000])
def test_a_full_disk_keeps_what_was_there(commands, monkeypatch, found, n_byte):
    """As a limit of the size of files; results lie beside the old ones until all are written."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def full(*_):
        resource.setrlimit(resource.RLIMIT_FSIZE, (n_byte, before[1]))
        return found

    monkeypatch.setattr(fit, "recover", full)
    try:
        status, out, err = commands.fit()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert (status, out) == (2, "")
    assert err.splitlines()[-1].startswith(f"error: {commands.folder / 'out'}: cannot be written (")
    untouched(commands)


def test_a_second_fit_into_a_folder_waits_or_is_refused(commands, monkeypatch, found):
    monkeypatch.setattr(atomic, "PATIENCE", 0.2)
    monkeypatch.setattr(fit, "recover", lambda *_: found)
    with atomic.atomic_folder(commands.folder / "out"):
        assert "another process writes into this folder" in commands.fit()[2]
    untouched(commands)
    assert commands.fit()[0] == 0


# ---------------------------------------------------------------------- what ends a process

CHILD = """
import os, resource, signal, sys
from evsdr.commands import fit
from evsdr.progress import Stages

fault, stage, *words = sys.argv[1:]
real, moved = Stages.show, os.replace

def kill(*_):
    os.kill(os.getpid(), signal.SIGKILL)

def short():
    pages = int(open("/proc/self/statm").read().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (4096 * pages + (30 << 20), -1))

def show(self, name, share):
    real(self, name, share)
    if name.startswith(stage):
        {"kill": kill, "memory": short, "moving": lambda: setattr(os, "replace", half)}[fault]()

def half(source, target):
    moved(source, target)
    if target.name == "maps.npz":
        kill()

Stages.show = show
raise SystemExit(fit.main(words))
"""
FAULTS = {
    "loading": ("kill", "load scene"),
    "solving": ("kill", "solve"),
    "moving": ("moving", "surface"),
    "memory": ("memory", "read events"),
}


@pytest.fixture(scope="module")
def ended(recorded, tmp_path_factory):
    """Run all children side by side; gives folder, status and standard error of each."""
    folders, children = {}, {}
    for name, words in FAULTS.items():
        folders[name] = tmp_path_factory.mktemp(name)
        (folders[name] / "summary.json").write_text("an earlier run")
        files = [recorded / "scene.xml", recorded / "events.h5", "--out", folders[name], "--preset", "fast"]
        children[name] = subprocess.Popen(
            [sys.executable, "-c", CHILD, *words, *map(str, files)],
            cwd=REPOSITORY,
            stderr=subprocess.PIPE,
            text=True,
        )
    said = {name: child.communicate(timeout=120)[1] for name, child in children.items()}
    return {name: (folders[name], children[name].returncode, said[name]) for name in FAULTS}


@pytest.mark.parametrize("name", ["loading", "solving"])
def test_killed_before_it_writes_a_fit_leaves_all_as_it_was(ended, name):
    folder, status, _ = ended[name]
    assert status == -signal.SIGKILL
    assert [path.name for path in folder.iterdir()] == ["summary.json"]
    assert (folder / "summary.json").read_text() == "an earlier run"


def test_killed_while_files_move_a_fit_leaves_no_seal_and_the_next_one_mends_it(ended, commands):
    folder, status, _ = ended["moving"]
    assert status == -signal.SIGKILL
    left = {path.name for path in folder.iterdir()}
    assert "summary.json" not in left and any(name.startswith(atomic.PREFIX) for name in left)
    with pytest.raises(evsdr.InputError):
        evsdr.read_results(folder)
    assert commands.fit(out=folder)[0] == 0
    evsdr.read_results(folder)
    assert not any(path.name.startswith(".") for path in folder.iterdir())


@pytest.mark.skipif(not os.path.isfile("/proc/self/statm"), reason="tells how much memory a process has")
def test_memory_that_runs_out_is_told_in_a_sentence(ended):
    folder, status, err = ended["memory"]
    assert status in (2, 70) and "memory" in err.splitlines()[-1], err
    assert (folder / "summary.json").read_text() == "an earlier run"
