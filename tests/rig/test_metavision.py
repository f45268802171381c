"""HDF5 files of cameras: all styles of ECF are read back, other layouts too, faults are named."""

import h5py
import numpy as np
import pytest

from evsdr.errors import InputError, InputWarning
from evsdr.files.events_h5 import EVENT_DTYPE
from evsdr.rig.metavision import read_hdf5
from tests.support.camera_files import (
    assert_same,
    make_recording,
    random_recording,
    write_metavision,
)


@pytest.fixture
def camera(rng):
    return random_recording(rng, n_event=5500, n_edge=7, duration_us=2_000_000, start_us=2**40)


@pytest.mark.parametrize("style", [0, 1, 2, 3])
@pytest.mark.parametrize("chunk", [997, 6000])
def test_round_trip(tmp_path, rng, style, chunk):
    camera = random_recording(rng, 5500, 7, duration_us=2_000_000, start_us=2**40, width=1280, height=720)
    path = tmp_path / "a.hdf5"
    write_metavision(path, camera, style, chunk)
    assert_same(read_hdf5(path), camera)


@pytest.mark.parametrize("style", [0, 1, 2])
def test_long_runs_and_long_steps(tmp_path, style):
    """Runs of 400 in t, y and p need their long form, and so does a step of time of 40 bits."""
    t = np.repeat([7, 22, 36, 37, 2**40], 400)
    camera = make_recording(np.arange(2000) % 64, np.repeat([5, 6], 1000), np.repeat([1, 0, 1, 0], 500), t)
    path = tmp_path / "a.hdf5"
    write_metavision(path, camera, style, chunk=3000)
    assert_same(read_hdf5(path), camera)


def test_plain_layout(tmp_path, camera):
    """Other order and widths of fields, gzip, size in two attributes, no triggers."""
    path = tmp_path / "a.h5"
    table = np.zeros(len(camera.events), [("t", ">u8"), ("p", "?"), ("y", "<i4"), ("x", "<u4")])
    for name in table.dtype.names:
        table[name] = getattr(camera.events, name)
    with h5py.File(path, "w") as file:
        file.create_dataset("CD/events", data=table, compression="gzip")
        file.attrs["width"], file.attrs["height"] = camera.width, camera.height
    read = read_hdf5(path)
    assert len(read.edges) == 0
    for name in ("x", "y", "p", "t"):
        np.testing.assert_array_equal(getattr(read.events, name), getattr(camera.events, name))


def test_size_by_hand_and_events_outside(tmp_path, camera):
    path = tmp_path / "a.hdf5"
    write_metavision(path, camera, 2)
    with h5py.File(path, "r+") as file:
        del file.attrs["geometry"]
    assert_refused(path, "do not tell the sensor's size; give it by --sensor-size")
    assert read_hdf5(path, (64, 48)).width == 64
    with h5py.File(path, "r+") as file:
        file.attrs["geometry"] = np.bytes_("64x48")
    assert read_hdf5(path).height == 48
    with pytest.raises(InputError, match="lie outside the sensor of 20 x 48 pixels"):
        read_hdf5(path, (20, 48))
    n_outside = np.count_nonzero(camera.events.x == 63)
    if n_outside <= 0.01 * len(camera.events):
        with pytest.warns(InputWarning, match=f"{n_outside} events outside the sensor of 63 x 48 pixels"):
            read_hdf5(path, (63, 48))


def change(path, name, table):
    with h5py.File(path, "r+") as file:
        del file[name]
        if table is not None:
            file[name] = table


RECORD = [("x", "<i4"), ("y", "<i4"), ("p", "<i4"), ("t", "<i8")]
FAULTS = [
    ("CD/events", None, "it lacks CD/events"),
    ("CD/events", np.zeros(5), "it lacks CD/events"),
    ("CD/events", np.zeros(5, RECORD[1:]), "it lacks CD/events"),
    ("CD/events", np.zeros(0, RECORD), "it holds no events"),
    ("CD/events", np.array([(1, 2, 3, 4)], RECORD), "entry 0 of CD/events is no event"),
    ("CD/events", np.array([(1, 2, 1, 4), (65536, 2, 1, 4)], RECORD), "entry 1 of CD/events is no event"),
    ("CD/events", np.zeros(5, RECORD[:3] + [("t", "<f8")]), "CD/events must hold whole numbers"),
    ("EXT_TRIGGER/events", np.zeros(5, "i8"), "it lacks EXT_TRIGGER/events"),
]


@pytest.mark.parametrize("name, table, sentence", FAULTS, ids=range(len(FAULTS)))
def test_faults(tmp_path, camera, name, table, sentence):
    path = tmp_path / "a.hdf5"
    write_metavision(path, camera, 1)
    change(path, name, table)
    assert_refused(path, sentence)


def test_damaged_chunk(tmp_path, camera):
    path = tmp_path / "a.hdf5"
    write_metavision(path, camera, 0)
    with h5py.File(path) as file:
        chunk = file["CD/events"].id.get_chunk_info(2)
    data = bytearray(path.read_bytes())
    data[chunk.byte_offset : chunk.byte_offset + 40] = b"\xff" * 40
    path.write_bytes(data)
    assert_refused(path, "its events are damaged from number 2000 on")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.6, 0.99])
def test_cut_short(tmp_path, camera, share):
    path = tmp_path / "a.hdf5"
    write_metavision(path, camera, 2)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    assert_refused(path, "damaged or cut short" if share else "not a readable HDF5 file")


def test_unknown_filter(tmp_path, camera):
    path = tmp_path / "a.hdf5"
    write_metavision(path, camera, 2)
    with h5py.File(path, "r+") as file:
        del file["CD/events"]
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((100,))
        properties.set_filter(300, h5py.h5z.FLAG_OPTIONAL)
        kind, space = h5py.h5t.py_create(EVENT_DTYPE), h5py.h5s.create_simple((100,))
        h5py.h5d.create(file["CD"].id, b"events", kind, space, dcpl=properties)
    assert_refused(path, "compressed by filter 300, which can't be read here")


def assert_refused(path, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        read_hdf5(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and message.endswith(".") and "\n" not in message
