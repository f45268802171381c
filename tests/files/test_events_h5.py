"""events.h5: what is written is read back, and each fault is named in one sentence."""

import resource
import subprocess
import sys

import h5py
import numpy as np
import pytest

from evsdr.errors import InputError, InputWarning
from evsdr.files.atomic import atomic_folder, atomic_path
from evsdr.files.events_h5 import read_recording, write_recording
from evsdr.records import Events, Recording, Schedule, Sensor

WIDTH, HEIGHT, N_EVENT = 12, 7, 500


@pytest.fixture
def recording() -> Recording:
    rng = np.random.default_rng(0)
    events = Events(
        x=rng.integers(0, WIDTH, N_EVENT).astype(np.uint16),
        y=rng.integers(0, HEIGHT, N_EVENT).astype(np.uint16),
        p=rng.integers(0, 2, N_EVENT).astype(np.int8),
        t=np.sort(rng.integers(0, 50_000, N_EVENT)) + 2**40,
    )
    on = rng.uniform(0.2, 0.3, (HEIGHT, WIDTH)).astype(np.float32)
    sensor = Sensor(WIDTH, HEIGHT, on, 0.31, 17.5)
    schedule = Schedule(np.array([2, -1, 0, 1], np.int32), 2500.0, 0.25, 12.5)
    return Recording(events, sensor, schedule, 2**40 + np.arange(5) * 10_001)


@pytest.fixture
def path(tmp_path, recording):
    path = tmp_path / "events.h5"
    write_recording(path, recording)
    return path


def change(path, name, change_table):
    """Replace the dataset `name` by change_table(dataset as array)."""
    with h5py.File(path, "r+") as file:
        table = change_table(file[name][()])
        del file[name]
        if table is not None:
            file[name] = table


def negative_x(table):
    wide = table.astype([(name, "<i8") for name in table.dtype.names])
    wide["x"][50] = -1
    return wide


def set_field(field, index, value):
    def change_table(table):
        table[field][index] = value
        return table

    return change_table


def set_attribute(path, group, name, value):
    with h5py.File(path, "r+") as file:
        if value is None:
            del file[group].attrs[name]
        else:
            file[group].attrs[name] = value


def test_round_trip(path, recording):
    read = read_recording(path)
    for name in ("x", "y", "p", "t"):
        np.testing.assert_array_equal(getattr(read.events, name), getattr(recording.events, name))
        assert getattr(read.events, name).dtype == getattr(recording.events, name).dtype
        assert getattr(read.events, name).flags.c_contiguous
    np.testing.assert_array_equal(read.round_start_us, recording.round_start_us)
    np.testing.assert_array_equal(read.sensor.contrast_threshold_on, recording.sensor.contrast_threshold_on)
    np.testing.assert_array_equal(read.schedule.order, recording.schedule.order)
    assert (read.sensor.width, read.sensor.height) == (WIDTH, HEIGHT)
    assert (read.sensor.contrast_threshold_off, read.sensor.refractory_us) == (0.31, 17.5)
    assert (read.schedule.slot_us, read.schedule.crossfade, read.schedule.start_us) == (2500.0, 0.25, 12.5)


def test_mean_of_thresholds_stands_as_attribute(path, recording):
    with h5py.File(path) as file:
        mean = file["sensor"].attrs["contrast_threshold_on"]
    assert mean == pytest.approx(recording.sensor.contrast_threshold_on.mean(), rel=1e-6)


def test_other_layouts_are_read(path, recording):
    """Other field order and integer widths, bool polarity, size as text, falling edges, no crossfade fade."""
    with h5py.File(path, "r+") as file:
        table = file["CD/events"][()]
        other = np.empty(N_EVENT, [("t", "<u8"), ("p", "?"), ("y", "<i4"), ("x", ">u4"), ("spare", "<f4")])
        for name in ("x", "y", "p", "t"):
            other[name] = table[name]
        del file["CD/events"], file["EXT_TRIGGER/events"]
        file["CD/events"] = other
        edges = np.zeros(4, [("id", "u1"), ("p", "u1"), ("t", "<i8")])
        edges["p"], edges["t"] = [1, 0, 1, 0], [2**40 + 5, 2**40 + 6, 2**40 + 10_005, 2**40 + 10_006]
        file["EXT_TRIGGER/events"] = edges
        del file.attrs["width"], file.attrs["height"]
        file.attrs["geometry"] = f"{WIDTH}x{HEIGHT}"
    read = read_recording(path)
    for name in ("x", "y", "p", "t"):
        np.testing.assert_array_equal(getattr(read.events, name), getattr(recording.events, name))
    np.testing.assert_array_equal(read.round_start_us, [2**40 + 5, 2**40 + 10_005])
    assert (read.sensor.width, read.sensor.height) == (WIDTH, HEIGHT)


def test_filters_of_hdf5plugin_are_read(path, recording):
    import hdf5plugin

    with h5py.File(path, "r+") as file:
        table = file["CD/events"][()]
        del file["CD/events"]
        file.create_dataset("CD/events", data=table, **hdf5plugin.Zstd())
    script = "import sys, evsdr.files.events_h5 as r; print(r.read_recording(sys.argv[1]).events.t.sum())"
    # in a process that has not imported hdf5plugin yet
    done = subprocess.run([sys.executable, "-c", script, path], capture_output=True, text=True, check=True)
    assert int(done.stdout) == recording.events.t.sum()


def test_without_triggers_there_is_no_round_start(path):
    change(path, "EXT_TRIGGER/events", lambda _: None)
    assert read_recording(path).round_start_us.shape == (0,)


def test_only_falling_triggers_warn(path):
    change(path, "EXT_TRIGGER/events", set_field("p", slice(None), 0))
    with pytest.warns(InputWarning, match=r"events\.h5: EXT_TRIGGER/events has no edge with p = 1"):
        assert len(read_recording(path).round_start_us) == 0


@pytest.mark.parametrize("name, value", [("contrast_threshold_off", 0.3795), ("refractory_us", 52.0)])
def test_missing_sensor_attribute_warns(path, name, value):
    set_attribute(path, "sensor", name, None)
    with pytest.warns(InputWarning, match=rf"sensor lacks {name} \({value:g}\)"):
        assert getattr(read_recording(path).sensor, name) == value


def test_missing_sensor_warns_once_of_all(path):
    with h5py.File(path, "r+") as file:
        del file["sensor"]
    with pytest.warns(InputWarning) as caught:
        sensor = read_recording(path).sensor
    assert len(caught) == 1
    for text in ("contrast_threshold_on (0.2525)", "contrast_threshold_off (0.3795)", "refractory_us (52)"):
        assert text in str(caught[0].message)
    assert (sensor.contrast_threshold_on, sensor.contrast_threshold_off) == (0.2525, 0.3795)
    assert sensor.refractory_us == 52


def test_missing_crossfade_warns(path):
    set_attribute(path, "schedule", "crossfade", None)
    with pytest.warns(InputWarning, match="schedule lacks crossfade"):
        assert read_recording(path).schedule.crossfade == 0


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
    assert_refused(tmp_path, "there is no such file")


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


def test_numbers_written_must_be_finite(tmp_path, recording):
    schedule = Schedule(np.array([0, 1]), 100.0, np.nan)
    bad = Recording(recording.events, recording.sensor, schedule, recording.round_start_us)
    with pytest.raises(ValueError, match="crossfade must be finite"):
        write_recording(tmp_path / "events.h5", bad)
    assert list(tmp_path.iterdir()) == []


def test_failed_writing_keeps_the_old_file(path):
    before = path.read_bytes()
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:
        assert temporary.suffix == path.suffix
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_unwritable_place(tmp_path, recording):
    with pytest.raises(InputError, match=r"none/events\.h5: cannot be written \(No such file or directory\)"):
        write_recording(tmp_path / "none" / "events.h5", recording)


def test_full_disk(path, recording):
    before = path.read_bytes()
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limit[1]))
    try:
        with pytest.raises(InputError, match="cannot be written"):
            write_recording(path, recording)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert list(path.parent.iterdir()) == [path] and path.read_bytes() == before


def test_atomic_folder_moves_all_or_nothing(tmp_path):
    folder = tmp_path / "a" / "b"
    with pytest.raises(RuntimeError), atomic_folder(folder) as temporary:
        (temporary / "one").write_text("1")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    with atomic_folder(folder) as temporary:
        (temporary / "one").write_text("1")
        assert not (folder / "one").exists()
    assert [file.name for file in folder.iterdir()] == ["one"]
    with pytest.raises(InputError, match="one: cannot be written"), atomic_folder(folder / "one"):
        pass
    assert (folder / "one").read_text() == "1"
