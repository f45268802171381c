"""Any file of events is opened, as far as it tells."""

import json

import h5py
import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files.events_h5 import write_recording
from evsdr.viewing.source import open_watched
from tests.support.watched_files import N_LED, recorded


@pytest.fixture
def file(tmp_path):
    recording = recorded()
    write_recording(tmp_path / "events.h5", recording)
    return recording, tmp_path / "events.h5"


def test_an_events_h5_tells_all(file):
    recording, path = file
    watched = open_watched(path)
    assert watched.shape == (20, 20) and watched.n_event == len(recording.events)
    np.testing.assert_array_equal(watched.edges.t, recording.round_start_us)
    np.testing.assert_array_equal(watched.schedule.order, np.arange(N_LED))
    assert watched.sensor.guessed == ()


def test_of_many_events_the_first_are_taken(file):
    watched = open_watched(file[1], most=500)
    assert len(watched.events) <= 500 < watched.n_event


def test_a_log_of_the_ring_tells_the_schedule(file, tmp_path):
    recording, path = file
    with h5py.File(path, "r+") as h5:
        del h5["schedule"], h5["sensor"]
    assert open_watched(path).schedule is None
    log = {
        "format": "evsdr ring log",
        "version": 1,
        "order": [2, 0, 1],
        "slot_us": 5000,
        "crossfade": 0.5,
        "rounds_done": 3,
        "ended": "done",
    }
    (tmp_path / "ring.json").write_text(json.dumps(log))
    watched = open_watched(path, tmp_path / "ring.json")
    np.testing.assert_array_equal(watched.schedule.order, [2, 0, 1])
    assert watched.schedule.slot_us == 5000 and watched.sensor.guessed
    np.testing.assert_array_equal(watched.edges.t, recording.round_start_us)
    with h5py.File(path, "r+") as h5:
        del h5["EXT_TRIGGER"]
    with pytest.raises(InputError, match="nothing tells when rounds start"):
        open_watched(path, tmp_path / "ring.json")
    assert open_watched(path, tmp_path / "ring.json", start_us=700.0).schedule.start_us == 700


def test_no_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        open_watched(tmp_path / "none.raw")
