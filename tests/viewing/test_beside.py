"""A preview as a process beside a recording: nothing that becomes of it touches the recording."""

import importlib.util
import json
import os
import signal
import subprocess
import threading
import time

import pytest

pytest.importorskip("websockets")
from websockets.sync.client import connect

from evsdr.errors import InputError, InputWarning
from evsdr.viewing import beside as module
from evsdr.viewing.beside import beside, check_preview
from tests.support.grown_files import ball, ball_raw

RING = tuple(ball().schedule.order.tolist()), ball().schedule.slot_us, 1.0


def listen(address, got):
    """Do what the page does, until the recording has ended."""
    origin, token = address.rstrip("/").rsplit("/", 1)
    with connect(f"{origin.replace('http', 'ws')}/{token}/feed", origin=origin) as page:
        got.extend(json.loads(text) for text in page)


def test_a_recording_is_shown_while_it_is_made(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(module, "END_S", 60.0)
    path, got = tmp_path / "a.raw", []
    with beside(path, *RING, wait_s=0) as address:
        listener = threading.Thread(target=listen, args=(address, got))
        listener.start()
        while not got:
            time.sleep(0.01)
        data = ball_raw()
        with open(path, "wb") as file:
            for begin in range(0, len(data), 16_384):
                file.write(data[begin : begin + 16_384])
                time.sleep(0.05)
    listener.join(60)
    assert got[-1]["ended"] and got[-1]["state"] == "locked" and got[-1]["n_round"] >= 3
    assert len({told["n_event"] for told in got}) > 1
    assert f"preview: {address}" in capfd.readouterr().err


@pytest.mark.parametrize("ill", [signal.SIGKILL, signal.SIGSTOP])
def test_an_ill_preview_does_not_hold_the_recording_up(tmp_path, monkeypatch, ill):
    started = []

    class Noted(subprocess.Popen):
        def __init__(self, *args, **kwargs):
            super().__init__(*args, **kwargs)
            started.append(self)

    monkeypatch.setattr(module.subprocess, "Popen", Noted)
    monkeypatch.setattr(module, "END_S", 0.2)
    with beside(tmp_path / "a.raw", *RING, wait_s=0):
        os.kill(started[0].pid, ill)
    assert started[0].returncode is not None


def test_a_preview_that_does_not_start_is_a_warning(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "START", "import sys; sys.exit(1)")
    with pytest.warns(InputWarning, match="the recording goes on without"):
        with beside(tmp_path / "a.raw", *RING) as address:
            assert address == ""


def test_what_can_not_be_shown_is_refused(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="--preview follows the file .* by --recording"):
        check_preview(None)
    check_preview(tmp_path)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"websockets is not installed; .*evsdr\[preview\]"):
        check_preview(tmp_path)
