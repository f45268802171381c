"""Events as columns of a HDF5 file: DSEC, RVT, M3ED."""

import h5py
import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.rig.columns import has_columns, read_columns
from tests.support.camera_files import assert_same, random_recording, write_metavision
from tests.support.foreign_files import write_dsec

OFFSET = 4_900_000_000_000


@pytest.fixture
def camera(rng):
    return random_recording(rng, n_event=500, n_edge=0, start_us=OFFSET)


def test_dsec(tmp_path, camera):
    path = tmp_path / "events.h5"
    write_dsec(path, camera, OFFSET)
    assert has_columns(path)
    assert_same(read_columns(path, (camera.width, camera.height)), camera)
    with pytest.raises(
        InputError, match="events.h5: its fields do not tell the sensor's size; .*--sensor-size"
    ):
        read_columns(path)


def test_sizes_that_are_told(tmp_path, camera):
    write_dsec(tmp_path / "rvt.h5", camera, OFFSET)
    with h5py.File(tmp_path / "rvt.h5", "r+") as file:
        file["events/width"], file["events/height"] = camera.width, camera.height
    assert_same(read_columns(tmp_path / "rvt.h5"), camera)
    with h5py.File(tmp_path / "rvt.h5", "r+") as file:
        file.move("events", "prophesee/left")
        del file["prophesee/left/width"]
        file["prophesee/left/calib/resolution"] = [camera.width, camera.height]
    assert_same(read_columns(tmp_path / "rvt.h5"), camera)


@pytest.mark.parametrize(
    "name, values, sentence",
    [
        ("x", np.zeros(3, np.uint16), "x, y, p and t of events differ in length"),
        ("y", np.zeros((3, 2)), "events/y must be a list of whole numbers"),
        ("x", np.full(498, -1), "its events are out of any bounds"),
        ("t", np.full(498, 2**63 - 1), "its events are out of any bounds"),
    ],
)
def test_damage(tmp_path, camera, name, values, sentence):
    path = tmp_path / "events.h5"
    write_dsec(path, camera, OFFSET)
    with h5py.File(path, "r+") as file:
        del file[f"events/{name}"]
        file[f"events/{name}"] = values
    with pytest.raises(InputError, match=sentence):
        read_columns(path, (camera.width, camera.height))


def test_other_layouts_have_no_columns(tmp_path, camera):
    write_metavision(tmp_path / "a.hdf5", camera, 1)
    assert not has_columns(tmp_path / "a.hdf5")
    with pytest.raises(InputError, match="it holds no columns"):
        read_columns(tmp_path / "a.hdf5")
