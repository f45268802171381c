"""The ring runs while a camera records: order of steps, what is left behind, dark on every failure."""

from types import SimpleNamespace

import pytest

from evsdr.errors import InputError
from evsdr.rig.capture import capture, run_to_end
from evsdr.rig.driver import RingSettings
from evsdr.rig.log import read_ring_log
from tests.support.ring_log import LOG

SETTINGS = RingSettings(order=(0, 3), slot_us=2500.0, rounds=5)


class Steps:
    """A ring and a camera in one, that note what is asked of them; `failing` is what raises."""

    def __init__(self, failing=None):
        self.steps, self.failing, self.polls = [], failing, 0
        self.log = SimpleNamespace(rounds_done=0, as_json=lambda: LOG)

    def step(self, name):
        self.steps.append(name)
        if name == self.failing:
            raise InputError(f"{name} fails.")

    def __enter__(self):
        return SimpleNamespace(
            configure=lambda settings: self.step("configure"),
            start=lambda: self.step("run"),
            wait=self.wait,
            log=self.log,
        )

    def __exit__(self, *_):
        self.steps.append("dark")

    def wait(self, _):
        self.polls += 1
        self.log.rounds_done = 2 * self.polls
        return self.polls > 2

    def start(self, path):
        self.path = path
        self.step("record")

    def stop(self):
        self.step("stop")
        self.path.write_bytes(b"events")
        return self.path

    def abandon(self):
        self.step("abandon")


def test_the_camera_records_before_and_after_the_run(tmp_path):
    both = Steps()
    recording, log = capture(both, lambda: both, SETTINGS, tmp_path / "run")
    assert both.steps == ["configure", "record", "run", "dark", "stop"]
    assert recording.read_bytes() == b"events"
    assert read_ring_log(log).n_round == LOG["rounds_done"]
    assert {recording, log} == set((tmp_path / "run").iterdir())


@pytest.mark.parametrize(
    ("failing", "steps"),
    [
        ("configure", ["configure", "dark"]),
        ("record", ["configure", "record", "dark"]),
        ("run", ["configure", "record", "run", "abandon", "dark"]),
        ("stop", ["configure", "record", "run", "dark", "stop"]),
    ],
)
def test_whatever_fails_the_ring_ends_dark_and_no_log_is_left(tmp_path, failing, steps):
    both = Steps(failing)
    with pytest.raises(InputError, match=f"{failing} fails"):
        capture(both, lambda: both, SETTINGS, tmp_path)
    assert both.steps == steps
    assert list(tmp_path.iterdir()) == []


def test_progress_tells_the_round_and_the_share():
    both, told = Steps(), []
    with both as ring:
        run_to_end(ring, 8, lambda *now: told.append(now))
    assert told == [("round 3", 0.25), ("round 5", 0.5)]
