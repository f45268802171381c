"""The camera by hand, and by the vendor's SDK."""

import builtins
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from evsdr.errors import InputError
from evsdr.rig import camera as cameras
from evsdr.rig.camera import ManualCamera, SdkCamera, open_camera


def test_manual_camera_asks(tmp_path):
    asked = []
    camera = ManualCamera(None, lambda text: asked.append(text) or f" '{tmp_path}/a.raw' ")
    camera.start(tmp_path / "recording.raw")
    assert camera.stop() == tmp_path / "a.raw"
    assert "press record now" in asked[0] and "type the path" in asked[1]


def test_manual_camera_waits_for_the_file_to_be_complete(tmp_path):
    path = tmp_path / "a.raw"
    path.write_bytes(b"old")
    camera = ManualCamera(path, lambda text: "", quiet_s=0.5)
    camera.start(tmp_path / "recording.raw")

    def grow():
        time.sleep(0.7)  # longer than a complete file is quiet
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


def test_what_grows_is_known_unless_the_user_types_its_name_later(tmp_path):
    path = tmp_path / "recording.raw"
    assert SdkCamera(None).growing(path) == tmp_path / ".recording.raw"
    assert ManualCamera(tmp_path / "a.raw").growing(path) == tmp_path / "a.raw"
    assert ManualCamera(None).growing(path) is None
