"""Each fault of an events.h5 is named in one sentence."""

import h5py
import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files.events_h5 import read_recording, write_recording
from tests.support.recording_file import HEIGHT, WIDTH, change, set_attribute, set_field, small_recording


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "events.h5"
    write_recording(path, small_recording())
    return path


def negative_x(table):
    wide = table.astype([(name, "<i8") for name in table.dtype.names])
    wide["x"][50] = -1
    return wide


def drop_field(field):
    return lambda table: table[[name for name in table.dtype.names if name != field]].copy()


def float_times(table):
    return table.astype([(n, "<f8" if n == "t" else table.dtype[n]) for n in table.dtype.names])


TABLE_FAULTS = [
    ("CD/events", lambda table: None, "the dataset CD/events is missing"),
    ("CD/events", lambda table: table["t"], "CD/events must be a list of records"),
    ("CD/events", lambda table: table.reshape(5, -1), "CD/events must be a list of records"),
    ("CD/events", drop_field("y"), "CD/events must be a list of records"),
    ("CD/events", float_times, "CD/events must be a list of records"),
    ("CD/events", lambda table: table[:0], "CD/events holds 0 events"),
    ("CD/events", lambda table: table[:1], "CD/events holds 1 events"),
    ("CD/events", set_field("p", slice(None), 1), "p of CD/events is 1 for every event"),
    ("CD/events", set_field("p", 40, -1), "p of CD/events is -1 at entry 40"),
    ("CD/events", set_field("x", 30, WIDTH), f"event 30 of CD/events at x={WIDTH}"),
    ("CD/events", set_field("y", 31, HEIGHT), "event 31 of CD/events at x="),
    ("CD/events", negative_x, "event 50 of CD/events at x=-1"),
    ("CD/events", set_field("t", 20, 0), "t of CD/events runs backwards at event 20"),
    ("EXT_TRIGGER/events", lambda table: table["t"], "EXT_TRIGGER/events must be a list of records"),
    ("EXT_TRIGGER/events", set_field("p", 0, 2), "p of EXT_TRIGGER/events is 2"),
    ("EXT_TRIGGER/events", set_field("t", 3, 0), "t of EXT_TRIGGER/events does not grow at round start 3"),
    ("schedule/order", lambda order: None, "schedule/order must be a list of integers"),
    ("schedule/order", lambda order: order[:0], "schedule/order must be a list of integers"),
    ("schedule/order", lambda order: order.astype(float), "schedule/order must be a list of integers"),
    ("schedule/order", lambda order: order - 1, "schedule/order goes from -2"),
    ("schedule/order", lambda order: order * 0 - 1, "schedule/order goes from -1 to -1"),
    ("schedule/order", lambda order: order + 254, "schedule/order goes from 253 to 256"),
    ("sensor/contrast_threshold_on", lambda on: on[1:], r"sensor/contrast_threshold_on must be an array"),
    ("sensor/contrast_threshold_on", lambda on: on - on[2, 3], "sensor/contrast_threshold_on is .* at x="),
    ("sensor/contrast_threshold_on", lambda on: on / 0, "sensor/contrast_threshold_on is inf at x=0, y=0"),
    ("schedule/trim", lambda trim: trim[None], "schedule/trim must be a list of numbers"),
    ("schedule/trim", lambda trim: trim + 0.5, "schedule/trim of LED 1 is 1.5"),
    ("schedule/trim", lambda trim: trim * np.nan, "schedule/trim of LED 0 is nan"),
    ("schedule", lambda group: None, "the group schedule is missing"),
]


@pytest.mark.parametrize("name, change_table, sentence", TABLE_FAULTS, ids=[f[2][:45] for f in TABLE_FAULTS])
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_faults_of_tables(path, name, change_table, sentence):
    if name == "schedule":
        with h5py.File(path, "r+") as file:
            del file[name]
    else:
        change(path, name, change_table)
    assert_refused(path, sentence)


@pytest.mark.parametrize(
    "group, name, value, sentence",
    [
        ("/", "width", None, "attribute width of the file is missing"),
        ("/", "height", 0, "attributes width and height are 12 and 0"),
        ("/", "width", -3, "attributes width and height are -3 and 7"),
        ("/", "width", 10.5, "attributes width and height are 10.5 and 7"),
        ("/", "width", [12, 12], "attribute width of the file is not a finite number"),
        ("sensor", "contrast_threshold_off", 0.0, "attribute contrast_threshold_off of sensor is 0;"),
        ("sensor", "contrast_threshold_off", -0.1, "attribute contrast_threshold_off of sensor is -0.1;"),
        ("sensor", "contrast_threshold_off", np.nan, "contrast_threshold_off of sensor is not a finite"),
        ("sensor", "refractory_us", -1.0, "attribute refractory_us of sensor is -1;"),
        ("schedule", "slot_us", None, "attribute slot_us of schedule is missing"),
        ("schedule", "slot_us", 0.0, "attribute slot_us of schedule is 0;"),
        ("schedule", "slot_us", np.nan, "attribute slot_us of schedule is not a finite number"),
        ("schedule", "slot_us", "long", "attribute slot_us of schedule is not a finite number"),
        ("schedule", "crossfade", 1.01, "attribute crossfade of schedule is 1.01;"),
        ("schedule", "crossfade", -0.01, "attribute crossfade of schedule is -0.01;"),
        ("schedule", "start_us", np.inf, "attribute start_us of schedule is not a finite number"),
    ],
)
def test_faults_of_attributes(path, group, name, value, sentence):
    set_attribute(path, group, name, value)
    assert_refused(path, sentence)


def assert_refused(path, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        read_recording(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and message.endswith(".") and "\n" not in message


def test_refractory_of_zero_is_allowed(path):
    set_attribute(path, "sensor", "refractory_us", 0.0)
    assert read_recording(path).sensor.refractory_us == 0


def test_missing_file(tmp_path):
    assert_refused(tmp_path / "none.h5", "there is no such file")
    assert_refused(tmp_path, "this is a folder")


def test_not_hdf5(tmp_path):
    path = tmp_path / "events.h5"
    path.write_text("x,y,p,t\n")
    assert_refused(path, "not a readable HDF5 file")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_cut_short(path, share):
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    assert_refused(path, "damaged or cut short")


def test_damaged_chunk(path):
    """The file opens, but its compressed events fail to unpack."""
    with h5py.File(path) as file:
        chunk = file["CD/events"].id.get_chunk_info(0)
    data = bytearray(path.read_bytes())
    data[chunk.byte_offset + 50 : chunk.byte_offset + 150] = bytes(100)
    path.write_bytes(data)
    assert_refused(path, "damaged or cut short")


def test_damaged_header(path):
    with h5py.File(path) as file:
        at = h5py.h5o.get_info(file["CD/events"].id).addr
    data = bytearray(path.read_bytes())
    data[at + 16 : at + 64] = b"\xff" * 48
    path.write_bytes(data)
    with pytest.raises(InputError, match="CD/events is missing|damaged"):
        read_recording(path)


def test_unknown_filter(path):
    """36559 is the vendor's ECF, which hdf5plugin does not have."""
    with h5py.File(path, "r+") as file:
        del file["CD/events"]
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((100,))
        properties.set_filter(36559, h5py.h5z.FLAG_OPTIONAL)
        dtype = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
        space = h5py.h5s.create_simple((100,))
        h5py.h5d.create(file["CD"].id, b"events", h5py.h5t.py_create(dtype), space, dcpl=properties)
    assert_refused(path, r"CD/events is compressed by filter 36559.*rewrite it with gzip")
