"""Recordings as EventPS publishes them."""

import lzma

import numpy as np
import pytest

from evsdr.errors import InputError, InputWarning
from evsdr.rig import eventps
from evsdr.rig.eventps import read_eventps
from tests.support.camera_files import assert_same, random_recording
from tests.support.foreign_files import write_eventps


@pytest.fixture
def camera(rng):
    return random_recording(rng, n_event=500, n_edge=0, duration_us=4_000_000)


def test_records_come_back(tmp_path, camera):
    write_eventps(tmp_path / "a.xz", camera)
    assert_same(read_eventps(tmp_path / "a.xz", (camera.width, camera.height)), camera)
    with pytest.warns(InputWarning, match="does not tell the sensor's size; 720 x 720 is taken"):
        assert read_eventps(tmp_path / "a.xz").width == 720


RIGHT = np.float32([3, 4, 1, 0.5])


@pytest.mark.parametrize(
    "data, sentence",
    [
        (RIGHT.tobytes()[:-4], "its 12 bytes are no records"),
        (np.float32([[3, 4, 1, 0.5], [3.5, 4, 1, 0.6]]).tobytes(), "record 1 is no event"),
        (np.float32([3, -4, 1, 0.5]).tobytes(), "record 0 is no event"),
        (np.float32([3, 4, 2, 0.5]).tobytes(), "record 0 is no event"),
        (np.float32([3, 4, 1, np.nan]).tobytes(), "record 0 is no event"),
        (b"", "it holds no events"),
    ],
)
def test_other_content(tmp_path, data, sentence):
    (tmp_path / "a.xz").write_bytes(lzma.compress(data))
    with pytest.raises(InputError, match=f"a.xz: .*{sentence}"):
        read_eventps(tmp_path / "a.xz", (8, 8))


def test_damage(tmp_path, monkeypatch):
    packed = lzma.compress(RIGHT.tobytes() * 1000)
    (tmp_path / "a.xz").write_bytes(packed[:-20])
    with pytest.raises(InputError, match="damaged or cut short"):
        read_eventps(tmp_path / "a.xz", (8, 8))
    (tmp_path / "a.xz").write_bytes(packed)
    monkeypatch.setattr(eventps, "free_memory", lambda: 10_000.0)
    with pytest.raises(InputError, match="larger than the free memory"):
        read_eventps(tmp_path / "a.xz", (8, 8))
