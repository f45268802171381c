"""events.h5: what is written is read back, and what is missing has a default."""

import resource
import subprocess
import sys
from dataclasses import replace

import h5py
import numpy as np
import pytest

from evsdr.errors import InputError, InputWarning
from evsdr.files.events_h5 import read_recording, write_recording
from evsdr.records import Recording, Schedule
from tests.support.recording_file import (
    HEIGHT,
    N_EVENT,
    WIDTH,
    change,
    set_attribute,
    set_field,
    small_recording,
)


@pytest.fixture
def recording():
    return small_recording()


@pytest.fixture
def path(tmp_path, recording):
    path = tmp_path / "events.h5"
    write_recording(path, recording)
    return path


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
    np.testing.assert_array_equal(read.schedule.trim, recording.schedule.trim)
    assert read.schedule.constant_light_on is False


def test_brightness_and_constant_light_may_be_untold(tmp_path, recording):
    untold = replace(recording, schedule=replace(recording.schedule, trim=None, constant_light_on=None))
    write_recording(tmp_path / "a.h5", untold)
    schedule = read_recording(tmp_path / "a.h5").schedule
    assert schedule.trim is None and schedule.constant_light_on is None


def test_how_well_thresholds_were_measured_is_kept(tmp_path, recording):
    assert recording.sensor.contrast_threshold_tolerance == 0.0
    for tolerance in (0.02, -0.02):
        sensor = replace(recording.sensor, contrast_threshold_tolerance=tolerance)
        write_recording(tmp_path / "a.h5", replace(recording, sensor=sensor))
        if tolerance > 0:
            assert read_recording(tmp_path / "a.h5").sensor.contrast_threshold_tolerance == tolerance
        else:
            with pytest.raises(InputError, match="contrast_threshold_tolerance of sensor is -0.02"):
                read_recording(tmp_path / "a.h5")


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


def test_numbers_written_must_be_finite(tmp_path, recording):
    schedule = Schedule(np.array([0, 1]), 100.0, np.nan)
    bad = Recording(recording.events, recording.sensor, schedule, recording.round_start_us)
    with pytest.raises(ValueError, match="crossfade must be finite"):
        write_recording(tmp_path / "events.h5", bad)
    assert list(tmp_path.iterdir()) == []


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
