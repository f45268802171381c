"""Capture with a fake ring and a fake camera: order of steps, files left behind, dark on every failure."""

import builtins
import json
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.commands.capture import Options, record_and_join
from evsdr.errors import InputError, InputWarning
from evsdr.files.events_h5 import read_recording
from evsdr.rig import camera as cameras
from evsdr.rig.camera import ManualCamera, SdkCamera, open_camera
from evsdr.rig.driver import Ring, RingSettings
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
        ) as host:  # fmt: skip
            host.stdin.write("\n")
            host.stdin.flush()
            end = time.monotonic() + 20
            while not fake.lit and time.monotonic() < end:
                time.sleep(0.01)
            assert fake.lit
            host.send_signal(signal.SIGINT)
            _, err = host.communicate(timeout=20)
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


# ---- the camera by hand ----------------------------------------------------------------------------------


def test_manual_camera_asks(tmp_path):
    asked = []
    camera = ManualCamera(None, lambda text: asked.append(text) or f" '{tmp_path}/a.raw' ")
    camera.start(tmp_path / "recording.raw")
    assert camera.stop() == tmp_path / "a.raw"
    assert "press record now" in asked[0] and "type the path" in asked[1]


def test_manual_camera_waits_for_the_file_to_be_complete(tmp_path):
    path = tmp_path / "a.raw"
    path.write_bytes(b"old")
    camera = ManualCamera(path, lambda text: "", quiet_s=0.2)
    camera.start(tmp_path / "recording.raw")

    def grow():
        time.sleep(0.3)  # longer than a complete file is quiet
        for size in (10, 20, 30, 40):
            time.sleep(0.05)
            path.write_bytes(bytes(size))

    thread = threading.Thread(target=grow)
    thread.start()
    assert camera.stop() == path and path.stat().st_size == 40
    thread.join()


def test_manual_camera_loses_patience(tmp_path, monkeypatch):
    monkeypatch.setattr(cameras, "PATIENCE_S", 0.1)
    camera = ManualCamera(tmp_path / "a.raw", lambda text: "", quiet_s=0.02)
    camera.start(tmp_path / "recording.raw")
    with pytest.raises(InputError, match="a.raw: no new recording came"):
        camera.stop()


def test_nobody_at_the_keyboard(tmp_path):
    def ask(text):
        raise EOFError

    with pytest.raises(InputError, match="nobody answers at the keyboard"):
        ManualCamera(None, ask).start(tmp_path / "recording.raw")


# ---- the vendor's SDK ------------------------------------------------------------------------------------


class FakeSdk:
    """What of metavision_hal is used: data flow into the file only while they are taken."""

    def __init__(self, lose=False, trigger=True, device=True):
        self.I_TriggerIn = SimpleNamespace(Channel=SimpleNamespace(MAIN="main"))
        self.DeviceDiscovery = SimpleNamespace(open=lambda serial: self if device else None)
        self.lose, self.trigger, self.calls, self.taken = lose, trigger, [], 0

    def get_i_trigger_in(self):
        return SimpleNamespace(enable=lambda channel: channel == "main") if self.trigger else None

    def get_i_events_stream(self):
        return self

    def log_raw_data(self, path):
        self.file = Path(path)
        self.file.write_bytes(b"")
        return True

    def start(self):
        self.calls.append("start")

    def poll_buffer(self):
        return -1 if self.lose else int(self.taken < 3)

    def get_latest_raw_data(self):
        self.taken += 1
        with open(self.file, "ab") as file:
            file.write(b"data")

    def stop_log_raw_data(self):
        self.calls.append("stop log")

    def stop(self):
        self.calls.append("stop")


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(cameras, "SETTLE_S", 0.1)


def test_sdk_camera_records(tmp_path, quick):
    sdk = FakeSdk()
    camera = SdkCamera(sdk)
    camera.start(tmp_path / "recording.raw")
    assert not (tmp_path / "recording.raw").exists()
    assert camera.stop() == tmp_path / "recording.raw"
    assert (tmp_path / "recording.raw").read_bytes() == b"data" * 3
    assert sdk.calls == ["start", "stop log", "stop"] and len(list(tmp_path.iterdir())) == 1


def test_sdk_camera_that_is_lost_or_abandoned_leaves_nothing(tmp_path, quick):
    camera = SdkCamera(FakeSdk(lose=True))
    camera.start(tmp_path / "recording.raw")
    with pytest.raises(InputError, match="the camera stopped sending"):
        camera.stop()
    assert list(tmp_path.iterdir()) == []
    camera = SdkCamera(FakeSdk())
    camera.start(tmp_path / "recording.raw")
    camera.abandon()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fault", ["device", "trigger"])
def test_sdk_camera_that_does_not_start(tmp_path, fault):
    with pytest.raises(InputError, match="can't be started .n.* plug it in"):
        SdkCamera(FakeSdk(**{fault: False})).start(tmp_path / "recording.raw")


def test_choice_of_camera(monkeypatch, tmp_path):
    sdk = FakeSdk()
    monkeypatch.setitem(sys.modules, "metavision_hal", sdk)
    assert isinstance(open_camera("auto"), SdkCamera) and isinstance(open_camera("sdk"), SdkCamera)
    assert isinstance(open_camera("manual"), ManualCamera)
    assert isinstance(open_camera("auto", tmp_path / "a.raw"), ManualCamera)
    monkeypatch.setitem(sys.modules, "metavision_hal", None)  # importing it fails
    assert isinstance(open_camera("auto"), ManualCamera)
    with pytest.raises(InputError, match="metavision_hal of the vendor's SDK can't be imported"):
        open_camera("sdk")
    assert builtins.input is open_camera("manual")._ask
