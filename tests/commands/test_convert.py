"""Camera file and ring log are joined into events.h5: rounds are found, mended or refused."""

import json

import h5py
import numpy as np
import pytest

from evsdr.commands.convert import main
from evsdr.errors import InputWarning
from evsdr.files.events_h5 import read_recording
from tests.support.camera_files import encode_raw, make_recording, write_metavision
from tests.support.foreign_files import write_eventps, write_eventps_triggers
from tests.support.ring_log import LOG, ORDER, SLOT_US, STARTS, pulses


@pytest.fixture
def camera(rng):
    n = 20_000
    t = np.sort(rng.integers(0, 70_000, n))
    x, y, p = rng.integers(0, 64, n), rng.integers(0, 48, n), rng.integers(0, 2, n)
    order = np.lexsort((x, p, y, t))  # as the vector formats tell them
    table = np.unique(np.stack([t, y, p, x])[:, order], axis=1)
    edges = pulses(STARTS)
    return make_recording(table[3], table[1], table[2], table[0], edges.p, edges.t, edges.id)


@pytest.fixture
def files(tmp_path, camera):
    (tmp_path / "camera.raw").write_bytes(encode_raw(camera, "EVT3"))
    (tmp_path / "ring.json").write_text(json.dumps(LOG))
    return tmp_path


def run(folder, *options, recording="camera.raw"):
    return main([str(folder / recording), "--ring", str(folder / "ring.json"), *options])


SENSOR = ("--threshold-on", "0.25", "--threshold-off", "0.5", "--refractory-us", "40")


@pytest.mark.parametrize("kind", ["EVT2", "EVT21", "EVT3", "hdf5"])
def test_joined_file_holds_the_rounds(files, camera, kind, capsys):
    if kind == "hdf5":
        write_metavision(files / "camera.raw", camera, 1)
    else:
        (files / "camera.raw").write_bytes(encode_raw(camera, kind))
    assert run(files, *SENSOR) == 0
    read = read_recording(files / "events.h5")
    inside = (camera.events.t >= STARTS[0]) & (camera.events.t < STARTS[-1])
    assert 0 < inside.sum() < len(inside)
    for name in ("x", "y", "p", "t"):
        np.testing.assert_array_equal(getattr(read.events, name), getattr(camera.events, name)[inside])
    np.testing.assert_array_equal(read.round_start_us, STARTS)
    np.testing.assert_array_equal(read.schedule.order, ORDER)
    assert (read.schedule.slot_us, read.schedule.crossfade) == (SLOT_US, 0.75)
    sensor = read.sensor
    assert (sensor.width, sensor.height) == (64, 48)
    assert (sensor.contrast_threshold_on, sensor.contrast_threshold_off, sensor.refractory_us) == (
        0.25,
        0.5,
        40,
    )
    printed = capsys.readouterr()
    assert f"{inside.sum():,}" in printed.out and "1.000000" in printed.out and not printed.err


def test_unknown_sensor_values_are_left_out(files):
    assert run(files, "--threshold-off", "0.5") == 0
    with pytest.warns(
        InputWarning, match=r"sensor lacks contrast_threshold_on \(0.2525\), refractory_us \(52\)"
    ):
        assert read_recording(files / "events.h5").sensor.contrast_threshold_off == 0.5


@pytest.mark.parametrize("kind", ["npz", "h5"])
@pytest.mark.parametrize("cropped", [False, True])
def test_threshold_file_and_crop(files, camera, rng, kind, cropped):
    on = rng.uniform(0.2, 0.3, (48, 64)).astype(np.float32)
    stored = on[10:40, 8:28] if cropped else on
    if kind == "npz":
        np.savez(files / "c.npz", contrast_threshold_on=stored, contrast_threshold_off=0.4)
    else:
        with h5py.File(files / "c.h5", "w") as file:  # as `python -m evsdr.calibrate thresholds` writes it
            group = file.create_group("sensor")
            group["contrast_threshold_on"], group["contrast_threshold_off"] = stored, 0.4
            group.attrs["contrast_threshold_on"], group.attrs["refractory_us"] = on.mean(), 99.0
            group.attrs["contrast_threshold_tolerance"] = 0.03
    region = ("--crop", "8", "10", "20", "30")
    told = kind == "h5" and not cropped  # else by option, which wins
    refractory = () if told else ("--refractory-us", "30")
    assert run(files, "--thresholds", str(files / f"c.{kind}"), *refractory, *region) == 0
    read = read_recording(files / "events.h5")
    np.testing.assert_array_equal(read.sensor.contrast_threshold_on, on[10:40, 8:28])
    assert (read.sensor.width, read.sensor.height) == (20, 30)
    assert read.sensor.contrast_threshold_off == pytest.approx(0.4)
    assert read.sensor.contrast_threshold_tolerance == (0.03 if kind == "h5" else 0)
    assert read.sensor.refractory_us == (99 if told else 30)
    e = camera.events
    inside = (e.t >= STARTS[0]) & (e.t < STARTS[-1]) & (e.x >= 8) & (e.x < 28) & (e.y >= 10) & (e.y < 40)
    np.testing.assert_array_equal(read.events.y, e.y[inside] - 10)


def test_times_are_the_cameras(files):
    """The ring's clock runs 0.4 % slow."""
    (files / "ring.json").write_text(json.dumps(LOG | {"slot_us": 2490.0}))
    assert run(files, *SENSOR) == 0
    assert read_recording(files / "events.h5").schedule.slot_us == pytest.approx(SLOT_US)


def test_start_by_hand(files, camera):
    assert run(files, *SENSOR, "--start-us", "12000", "--out", str(files / "other.h5")) == 0
    read = read_recording(files / "other.h5")
    assert len(read.round_start_us) == 0 and read.schedule.start_us == 12_000
    inside = (camera.events.t >= 12_000) & (camera.events.t < 62_000)
    np.testing.assert_array_equal(read.events.t, camera.events.t[inside])


# ---- without ring.json -----------------------------------------------------------------------------------


def alone(folder, *options, recording="camera.raw"):
    return main([str(folder / recording), *options])


def test_options_in_place_of_the_log(files):
    assert run(files, *SENSOR) == 0
    joined = read_recording(files / "events.h5")
    order = ("--order", *map(str, ORDER))
    assert alone(files, *SENSOR, *order, "--crossfade", "0.75", "--out", str(files / "b.h5")) == 0
    told = read_recording(files / "b.h5")
    np.testing.assert_array_equal(told.events.t, joined.events.t)
    np.testing.assert_array_equal(told.round_start_us, STARTS)
    np.testing.assert_array_equal(told.schedule.order, ORDER)
    assert (told.schedule.slot_us, told.schedule.crossfade) == (SLOT_US, 0.75)
    by_hand = (
        *order,
        "--slot-us",
        "2500",
        "--start-us",
        "7000",
        "--rounds",
        "5",
        "--out",
        str(files / "c.h5"),
    )
    assert alone(files, *SENSOR, *by_hand) == 0
    np.testing.assert_array_equal(read_recording(files / "c.h5").events.t, joined.events.t)


def test_a_recording_of_eventps(files, camera):
    write_eventps(files / "events.xz", camera)
    write_eventps_triggers(files / "trigger.xz", STARTS)
    beside = ("--triggers", str(files / "trigger.xz"), "--sensor-size", "64", "48", "--n-led", "4")
    assert alone(files, *SENSOR, *beside, recording="events.xz") == 0
    read = read_recording(files / "events.h5")
    np.testing.assert_array_equal(read.round_start_us, STARTS)
    assert read.schedule.order.tolist() == [0, 1, 2, 3] and read.schedule.crossfade == 1
    inside = (camera.events.t >= STARTS[0]) & (camera.events.t < STARTS[-1])
    np.testing.assert_array_equal(read.events.x, camera.events.x[inside])


def test_asked_too_little_it_tells_what_the_file_holds(files, capsys):
    assert alone(files) == 2
    printed = capsys.readouterr()
    assert "trigger input 0, rising" in printed.out and "6 from 0.007000 s, 10 ms apart" in printed.out
    assert printed.err.endswith("give its ring.json by --ring, or --order or --n-led.\n")
    assert printed.err.count("\n") == 1 and not (files / "events.h5").exists()


@pytest.mark.parametrize(
    "options, sentence",
    [
        (("--ring", "ring.json", "--rounds", "5"), "--ring tells order, slots, crossfade and rounds"),
        (("--n-led", "4", "--order", "0", "1"), "--order and --n-led tell the same"),
        (("--n-led", "1"), "--n-led is 1"),
        (("--n-led", "4", "--slot-us", "-1"), "--slot-us is -1"),
        (("--n-led", "4", "--slot-us", "999"), "a round of the ring takes 3.996 ms but"),
        (
            ("--n-led", "4", "--rounds", "9"),
            "but the ring made 9; check that what you tell of the ring belongs",
        ),
        (("--n-led", "4", "--triggers", "none"), "none: there is no such file"),
    ],
)
def test_what_does_not_go_together(files, capsys, options, sentence):
    assert alone(files, *options) == 2
    assert sentence in capsys.readouterr().err


# ---- hostile input ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options, sentence",
    [
        (("--crop", "60", "0", "20", "20"), "--crop 60 0 20 20 does not lie inside the sensor of 64 x 48"),
        (("--sensor-size", "0", "5"), "--sensor-size 0 5 is no size"),
        (("--sensor-size", "32", "48"), "lie outside the sensor of 32 x 48 pixels"),
        (("--threshold-on", "0"), "--threshold-on is 0"),
        (("--threshold-off", "nan"), "--threshold-off is nan"),
        (("--refractory-us", "-1"), "--refractory-us is -1"),
        (("--start-us", "nan"), "--start-us is not a finite number"),
        (("--start-us", "1e9"), "0 events lie within the rounds"),
        (("--trigger-id", "5"), "no rising trigger edge"),
        (("--thresholds", "none.npz"), "none.npz: this is no readable .npz or .h5 file"),
    ],
)
def test_wrong_options(files, capsys, options, sentence):
    assert run(files, *options) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and sentence in error and error.count("\n") == 1
    assert not (files / "events.h5").exists()


@pytest.mark.parametrize(
    "fields, sentence",
    [
        ({"a": 1}, "it holds none of contrast_threshold_on"),
        ({"contrast_threshold_on": np.ones((3, 3))}, "contrast_threshold_on must be a number or an array of"),
        (
            {"contrast_threshold_on": np.zeros((48, 64))},
            "contrast_threshold_on has values that are not above 0",
        ),
        ({"contrast_threshold_off": np.nan}, "contrast_threshold_off has values that are not above 0"),
        ({"refractory_us": np.ones((48, 64))}, "refractory_us must be a number"),
    ],
)
def test_wrong_threshold_files(files, capsys, fields, sentence):
    np.savez(files / "c.npz", **fields)
    assert run(files, "--thresholds", str(files / "c.npz"), "--refractory-us", "20") == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    "data, sentence",
    [
        (None, "there is no such file"),
        (b"", "neither a RAW nor a HDF5"),
        (bytes(900), "neither a RAW nor a HDF5"),
    ],
)
def test_wrong_recordings(files, capsys, data, sentence):
    (files / "camera.raw").unlink()
    if data is not None:
        (files / "camera.raw").write_bytes(data)
    assert run(files) == 2
    assert sentence in capsys.readouterr().err


def test_recording_is_never_overwritten(files, camera, capsys):
    write_metavision(files / "events.h5", camera, 1)
    before = (files / "events.h5").read_bytes()
    assert run(files, recording="events.h5") == 2
    assert "this is the recording itself" in capsys.readouterr().err
    assert (files / "events.h5").read_bytes() == before
