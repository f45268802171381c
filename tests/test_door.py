"""How commands begin: Ctrl-C while modules are imported is quiet, and a Python without what they need says so."""

import os
import shutil
import signal
import subprocess
import sys
import time

import pytest

from tests.conftest import REPOSITORY


def started(tmp_path, ignores=False):
    """Start a command whose imports take long, and wait until they do."""
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\nclass Slow:\n    def find_spec(self, name, *_):\n"
        "        if name == 'evsdr.commands.console':\n"
        "            import time; print('here', flush=True); time.sleep(0.7 if sys.argv[-1] == '--help' else 30)\n"
        "sys.meta_path.insert(0, Slow())\n"
    )
    path = os.pathsep.join([str(tmp_path), str(REPOSITORY)])
    command = [sys.executable, "-m", "evsdr.convert", *(["--help"] if ignores else [])]
    child = subprocess.Popen(
        command,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN if ignores else signal.SIG_DFL),
    )
    assert child.stdout.readline() == "here\n"
    return child


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_in_the_first_second_is_quiet(tmp_path):
    child, start = started(tmp_path), time.monotonic()
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=20)
    assert (child.returncode, out, err) == (-signal.SIGINT, "", "") and time.monotonic() - start < 10


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_process_told_to_ignore_ctrl_c_does(tmp_path):
    child = started(tmp_path, ignores=True)
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=20)
    assert child.returncode == 0 and "usage: python -m evsdr.convert" in out and err == ""


def lacks(tmp_path, package, environment=False):
    """Run a command of a copy of evsdr, beside an environment or not, by a Python that lacks a package; gives its sentence."""
    root = tmp_path / "a clone"
    shutil.copytree(REPOSITORY / "evsdr", root / "evsdr", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(REPOSITORY / "pyproject.toml", root)
    (root / "sitecustomize.py").write_text(
        "import sys\nclass Absent:\n    def find_spec(self, name, *_):\n"
        f"        if name == '{package}':\n            raise ModuleNotFoundError(f'No module named {{name}}', name=name)\n"
        "sys.meta_path.insert(0, Absent())\n"
    )
    if environment:
        (root / ".venv" / "bin").mkdir(parents=True)
        (root / ".venv" / "bin" / "activate").touch()
    command = [sys.executable, "-m", "evsdr.convert", "--help"]
    told = os.environ | {"PYTHONPATH": str(root)}
    done = subprocess.run(command, cwd=root, env=told, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr, root


def test_a_python_without_what_evsdr_needs_is_told_where_it_is(tmp_path):
    status, out, err, root = lacks(tmp_path, "tyro", environment=True)
    activate = f"'{root}/.venv/bin/activate'"
    assert (status, out) == (2, "")
    assert err == f"error: {sys.executable} has no package tyro; type . {activate} first.\n"


def test_or_how_it_is_installed(tmp_path):
    status, out, err, root = lacks(tmp_path, "numpy")
    install = f"{sys.executable} -m pip install '{root}'"
    assert (status, out, err) == (2, "", f"error: {sys.executable} has no package numpy; type {install}.\n")


def test_a_module_of_its_own_that_is_missing_is_a_fault(tmp_path):
    status, _, err, _ = lacks(tmp_path, "evsdr.errors")
    assert status == 1 and "Traceback" in err
