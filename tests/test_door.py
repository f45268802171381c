"""How commands begin: Ctrl-C while modules are imported is quiet."""

import os
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
