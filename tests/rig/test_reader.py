"""A camera's file is told by its content, not by its name."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.rig.reader import read_camera_file
from tests.support.camera_files import assert_same, encode_raw, random_recording, write_metavision
from tests.support.foreign_files import write_aedat, write_dsec, write_eventps


@pytest.fixture
def camera(rng):
    return random_recording(rng, n_event=500, n_edge=4)


def test_both_kinds_are_read_whatever_their_name(tmp_path, camera):
    (tmp_path / "one.hdf5").write_bytes(encode_raw(camera, "EVT3"))
    write_metavision(tmp_path / "two.raw", camera, 1)
    for name in ("one.hdf5", "two.raw"):
        assert_same(read_camera_file(tmp_path / name), camera)


def test_others_recordings_and_triggers_beside_them(tmp_path, camera):
    camera = replace(camera, edges=replace(camera.edges, id=0 * camera.edges.id))
    edges = replace(camera.edges, p=0 * camera.edges.p + 1)
    (tmp_path / "triggers").write_text("\n".join(map(str, edges.t)))
    path = tmp_path / "events.raw"
    for write in (write_eventps, lambda *it: write_dsec(*it, 5000), write_aedat):
        if write is write_aedat:
            pytest.importorskip("aedat")
        write(path, camera)
        read = read_camera_file(path, (camera.width, camera.height), tmp_path / "triggers")
        assert_same(read, replace(camera, edges=edges))


def test_a_size_by_hand_wins(tmp_path, camera):
    (tmp_path / "a.raw").write_bytes(encode_raw(camera, "EVT2"))
    write_metavision(tmp_path / "b.hdf5", camera, 1)
    for name in ("a.raw", "b.hdf5"):
        read = read_camera_file(tmp_path / name, (camera.width + 6, camera.height))
        assert (read.width, read.height) == (camera.width + 6, camera.height)
        np.testing.assert_array_equal(read.events.x, camera.events.x)
    with pytest.raises(InputError, match="--sensor-size 0 5 is no size"):
        read_camera_file(tmp_path / "a.raw", (0, 5))


def test_what_is_no_recording(tmp_path):
    (tmp_path / "a.raw").write_text("nothing")
    with pytest.raises(InputError, match="a.raw: this is neither a RAW nor a HDF5 file"):
        read_camera_file(tmp_path / "a.raw")
    with pytest.raises(InputError, match="b.raw: there is no such file"):
        read_camera_file(tmp_path / "b.raw")
