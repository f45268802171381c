"""Capture with a fake ring and a fake camera: order of steps, files left behind, dark on every failure."""

import json
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.commands.capture import Options, record_and_join
from evsdr.errors import InputError, InputWarning
from evsdr.files.events_h5 import read_recording
from evsdr.rig.driver import Ring, RingSettings
from evsdr.viewing import beside
from tests.conftest import REPOSITORY
from tests.support.camera_files import encode_raw, make_recording
from tests.support.fake_ring import FakeRing
from tests.support.ring_log import LOG, N_ROUND, STARTS, pulses

SENSOR = dict(threshold_on=0.25, threshold_off=0.4, refractory_us=52.0)


@pytest.fixture
def data(rng) -> bytes:
    """Give the bytes of a recording of the run that LOG tells."""
    t = np.sort(rng.choice(70_000, 5000, replace=False))
    x, y, p = rng.integers(0, 64, 5000), rng.integers(0, 48, 5000), rng.integers(0, 2, 5000)
    edges = pulses(STARTS)
    return encode_raw(make_recording(x, y, p, t, edges.p, edges.t, edges.id), "EVT3")


@pytest.fixture
def options(tmp_path) -> Options:
    return Options(
        port="none",
        out=tmp_path / "run",
        order=(0, 3, -1, 1),
        constant_light=True,
        slot_us=2500.0,
        crossfade=0.75,
        rounds=N_ROUND,
        **SENSOR,
    )


class StepRing:
    """A ring that notes what is asked of it; `failure` is raised while it runs."""

    def __init__(self, steps, failure=None, **changes):
        self.steps, self.failure = steps, failure
        self.log = SimpleNamespace(rounds_done=1, as_json=lambda: LOG | changes)
        self.polls = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.steps.append("dark")

    def configure(self, settings):
        self.steps.append("configure")
        self.settings = settings

    def start(self):
        self.steps.append("run")

    def wait(self, timeout_s):
        if self.failure:
            raise self.failure
        self.polls += 1
        return self.polls > 2


class FakeCamera:
    """A camera that writes its bytes at the end."""

    def __init__(self, steps, data):
        self.steps, self.data = steps, data

    def start(self, path):
        self.steps.append("start")
        self.path = path

    def growing(self, path):
        return path

    def stop(self):
        self.steps.append("stop")
        self.path.write_bytes(self.data)
        return self.path

    def abandon(self):
        self.steps.append("abandon")


def test_run_is_recorded_and_joined(options, data, capsys):
    steps = []
    ring = StepRing(steps)
    record_and_join(options, FakeCamera(steps, data), lambda: ring)
    assert steps == ["configure", "start", "run", "dark", "stop"]
    assert ring.settings == RingSettings((0, 3, -1, 1), 2500.0, 0.75, N_ROUND, constant_light=True)
    assert sorted(file.name for file in options.out.iterdir()) == ["events.h5", "recording.raw", "ring.json"]
    np.testing.assert_array_equal(read_recording(options.out / "events.h5").round_start_us, STARTS)
    assert json.loads((options.out / "ring.json").read_text()) == LOG
    assert "events" in capsys.readouterr().out


def test_a_preview_is_beside_the_whole_recording(options, data, monkeypatch):
    """It is there before the camera starts, and told what grows, the schedule and the region."""
    steps, told = [], []
    monkeypatch.setattr(beside, "beside", lambda *given: told.append(given) or noted(steps))
    options = replace(options, preview=True, crop=(0, 0, 64, 48))
    record_and_join(options, FakeCamera(steps, data), lambda: StepRing(steps))
    assert steps == ["preview", "configure", "start", "run", "dark", "stop", "end"]
    assert told == [(options.out / "recording.raw", (0, 3, -1, 1), 2500.0, 0.75, (0, 0, 64, 48))]


def test_to_focus_the_ring_blinks_beside_a_preview(options, data, monkeypatch):
    steps, told = [], []
    monkeypatch.setattr(beside, "beside", lambda *given: told.append(given) or noted(steps))
    ring = StepRing(steps)
    record_and_join(replace(options, focus=True), FakeCamera(steps, data), lambda: ring)
    assert told == [(options.out / "recording.raw", (0, -1), 100_000.0, 0.0, None)] and steps[-1] == "end"
    assert ring.settings.order == (0, -1) and ring.settings.rounds == 3000
    assert not (options.out / "events.h5").exists()


@contextmanager
def noted(steps):
    steps.append("preview")
    yield
    steps.append("end")


def test_what_the_camera_says_of_itself_is_kept(options, data):
    camera = FakeCamera([], data)
    camera.told = {"biases": {"bias_fo": 5}}
    record_and_join(options, camera, lambda: StepRing([]))
    assert json.loads((options.out / "camera.json").read_text()) == camera.told


def test_a_flicker_is_recorded_instead(options, data):
    ring = StepRing([])
    record_and_join(replace(options, flicker=True, constant_light=False), FakeCamera([], data), lambda: ring)
    assert ring.settings == RingSettings((0, -1, -1), 400_000.0, 1.0, 20, constant_light=True)


@pytest.mark.parametrize("failure", [InputError("the ring is gone."), KeyboardInterrupt()])
def test_failing_ring_ends_dark(options, data, failure):
    steps = []
    with pytest.raises(type(failure)):
        record_and_join(options, FakeCamera(steps, data), lambda: StepRing(steps, failure))
    assert steps == ["configure", "start", "run", "abandon", "dark"]
    assert list(options.out.iterdir()) == []


def test_failing_camera_leaves_the_ring_dark_and_unlit(options, data):
    steps = []
    camera = FakeCamera(steps, data)
    camera.start = lambda path: (_ for _ in ()).throw(InputError("no camera."))
    with pytest.raises(InputError, match="no camera"):
        record_and_join(options, camera, lambda: StepRing(steps))
    assert steps == ["configure", "dark"]


def test_run_that_can_not_be_joined_is_kept(options, data):
    steps = []
    with pytest.raises(
        InputError, match=r"saw 5 rounds .* but the ring made 9.*; the run is kept, so join it by"
    ):
        record_and_join(options, FakeCamera(steps, data), lambda: StepRing(steps, rounds_done=9))
    assert sorted(file.name for file in options.out.iterdir()) == ["recording.raw", "ring.json"]


def test_stopped_run_warns(options, data):
    with pytest.warns(InputWarning, match=r"did not end its run \(stopped\); its 2 complete rounds are used"):
        record_and_join(options, FakeCamera([], data), lambda: StepRing([], rounds_done=2, ended="stopped"))
    assert len(read_recording(options.out / "events.h5").round_start_us) == 3


def test_over_a_serial_line(options, data):
    """With the true driver; the ring at the other end answers as the firmware does."""
    with FakeRing(round_s=0.01) as fake:
        record_and_join(options, FakeCamera([], data), lambda: Ring(fake.port))
        assert not fake.lit and not fake.light
        assert "ORDER AD.B" in fake.commands and "LIGHT 1" in fake.commands
    recording = read_recording(options.out / "events.h5")
    assert recording.schedule.order.tolist() == [0, 3, -1, 1] and len(recording.round_start_us) == N_ROUND + 1


def test_ctrl_c_ends_dark_and_writes_nothing(tmp_path):
    with FakeRing(round_s=10.0) as fake:
        words = ["--port", fake.port, "--out", str(tmp_path / "run"), "--camera", "manual"]
        with subprocess.Popen(
            [sys.executable, "-m", "evsdr.capture", *words],
            cwd=REPOSITORY, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background jobs ignore it
        ) as host:  # fmt: skip
            host.stdin.write("\n")
            host.stdin.flush()
            end = time.monotonic() + 20
            while not fake.lit and time.monotonic() < end:
                time.sleep(0.01)
            assert fake.lit
            host.send_signal(signal.SIGINT)
            try:
                _, err = host.communicate(timeout=20)
            finally:
                host.kill()
        assert host.returncode == 130 and err.endswith("stopped; nothing was written.\n")
        assert not fake.lit
    assert list((tmp_path / "run").iterdir()) == []


def test_wrong_options(options, tmp_path):
    for wrong, sentence in (
        (dict(order=(0, 2)), "both hang on one chain"),
        (dict(rounds=0), "--rounds is 0"),
        (dict(out=tmp_path / "file" / "x"), "in the way"),
    ):
        (tmp_path / "file").write_text("")
        with pytest.raises(InputError, match=sentence):
            record_and_join(Options(**{**vars(options), **wrong}), None, None)
