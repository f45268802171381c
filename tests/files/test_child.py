"""Work that hangs or crashes ends a copy of this process, not the process."""

import os
import signal
import time

import pytest

from evsdr.files.child import survives

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes can't be copied here")


def crash():
    os.kill(os.getpid(), signal.SIGSEGV)


def test_work_that_ends_survives(capfd):
    for work in (lambda: None, lambda: 1 / 0, lambda: exit(3)):
        assert survives(work, 30.0)
    assert capfd.readouterr() == ("", "")


def test_work_that_crashes_or_hangs_does_not(capfd):
    assert not survives(crash, 30.0)
    start = time.monotonic()
    assert not survives(lambda: time.sleep(60), 0.1)
    assert time.monotonic() - start < 30
    assert capfd.readouterr() == ("", "")


def test_no_copy_and_no_pipe_is_left():
    before = os.listdir("/proc/self/fd") if os.path.isdir("/proc/self/fd") else ()
    survives(lambda: time.sleep(60), 0.01)
    assert len(before) == 0 or len(os.listdir("/proc/self/fd")) == len(before)
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)


def test_without_copies_it_is_hoped_for(monkeypatch):
    def refuse():
        raise BlockingIOError("too many processes")

    monkeypatch.setattr(os, "fork", refuse)
    assert survives(crash, 30.0)
