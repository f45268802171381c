"""Camera file and ring log are joined into events.h5: rounds are found, mended or refused."""

import json

import h5py
import numpy as np
import pytest

from evsdr.commands.convert import main
from evsdr.errors import InputError, InputWarning
from evsdr.files.events_h5 import read_recording
from evsdr.rig.camera_file import Edges
from evsdr.rig.log import parse_ring_log, read_ring_log
from evsdr.rig.rounds import find_rounds
from tests.support.camera_files import encode_raw, make_recording, write_metavision
from tests.support.ring_log import LOG, N_ROUND, ORDER, ROUND_US, SLOT_US, STARTS, pulses


def together(*edges: Edges) -> Edges:
    return Edges(*(np.concatenate([getattr(e, name) for e in edges]) for name in ("p", "t", "id")))


def log(**changes):
    return parse_ring_log(LOG | changes)


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
    region = ("--crop", "8", "10", "20", "30")
    told = kind == "h5" and not cropped  # else by option, which wins
    refractory = () if told else ("--refractory-us", "30")
    assert run(files, "--thresholds", str(files / f"c.{kind}"), *refractory, *region) == 0
    read = read_recording(files / "events.h5")
    np.testing.assert_array_equal(read.sensor.contrast_threshold_on, on[10:40, 8:28])
    assert (read.sensor.width, read.sensor.height) == (20, 30)
    assert read.sensor.contrast_threshold_off == pytest.approx(0.4)
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


# ---- rounds ----------------------------------------------------------------------------------------------


def test_camera_clock_is_measured():
    starts = np.rint(7000 + 1.003 * ROUND_US * np.arange(N_ROUND + 1)).astype(np.int64)
    rounds = find_rounds(pulses(starts), log())
    np.testing.assert_array_equal(rounds.start_us, starts)
    assert (
        rounds.clock_ratio == pytest.approx(1.003, abs=1e-6)
        and rounds.jitter_us < 1
        and len(rounds) == N_ROUND
    )


def test_slow_drift_is_followed():
    """Over 400 rounds the clocks drift apart by a quarter of a round."""
    starts = np.cumsum(np.r_[7000, np.linspace(10_000, 10_012, 400)]).astype(np.int64)
    rounds = find_rounds(pulses(starts), log(rounds_done=400))
    np.testing.assert_array_equal(rounds.start_us, starts)


def test_far_clock_warns():
    with pytest.warns(InputWarning, match="a round takes 1.0200 times as long on the camera's clock"):
        find_rounds(pulses(7000 + 10_200 * np.arange(N_ROUND + 1)), log())


def test_missing_edge_is_interpolated():
    with pytest.warns(InputWarning, match="trigger input 0 lacks the start of round 3; it is put where"):
        rounds = find_rounds(pulses(np.delete(STARTS, 2)), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


@pytest.mark.parametrize("at", [0, 3, N_ROUND])
def test_doubled_edge_is_left_out(at):
    starts = np.sort(np.r_[STARTS, STARTS[at] + 30])
    with pytest.warns(InputWarning, match=r"has 1 edges that start no round \(at 0\.0\d+ s\)"):
        rounds = find_rounds(pulses(starts, length=10), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


def test_every_edge_doubled():
    starts = np.stack([STARTS, STARTS + 30], axis=1).ravel()
    with pytest.warns(InputWarning, match="has 6 edges that start no round"):
        rounds = find_rounds(pulses(starts, length=10), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


def test_burst_of_edges_does_not_move_the_grid():
    burst = STARTS[2] + 40 * np.arange(1, 6)
    with pytest.warns(InputWarning, match="has 5 edges that start no round"):
        rounds = find_rounds(pulses(np.sort(np.r_[STARTS, burst]), length=10), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


def test_stray_edge_is_left_out():
    with pytest.warns(InputWarning, match=r"has 2 edges that start no round \(at 0.001000 s, 0.031000 s\)"):
        rounds = find_rounds(pulses(np.sort(np.r_[1000, STARTS, 31_000])), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


@pytest.mark.parametrize("kept", [slice(1, None), slice(None, -1)])
def test_lost_end_leaves_the_other_rounds(kept):
    with pytest.warns(InputWarning, match="lacks the first or the last edge; the 4 rounds between"):
        rounds = find_rounds(pulses(STARTS[kept]), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS[kept])


def test_stopped_ring_gives_its_complete_rounds():
    with pytest.warns(
        InputWarning, match=r"the ring did not end its run \(watchdog\); its 3 complete rounds"
    ):
        rounds = find_rounds(pulses(STARTS[:5]), log(rounds_done=3, ended="watchdog"))
    np.testing.assert_array_equal(rounds.start_us, STARTS[:4])


def test_falling_edges_of_an_active_low_trigger():
    edges = pulses(STARTS, low=True)
    np.testing.assert_array_equal(find_rounds(edges, log(), "falling").start_us, STARTS)
    with pytest.warns(
        InputWarning, match="begin with a falling edge, 200 us before .* give --trigger-edge falling"
    ):
        rounds = find_rounds(edges, log())
    np.testing.assert_array_equal(rounds.start_us, STARTS + 200)


def test_slot_edges_on_another_input_are_told_apart():
    slots = pulses(np.arange(STARTS[0], STARTS[-1], 2500), trigger_id=1)
    edges = together(slots, pulses(STARTS, trigger_id=3))
    assert find_rounds(edges, log()).trigger_id == 3
    np.testing.assert_array_equal(find_rounds(edges, log(), trigger_id=3).start_us, STARTS)
    assert_refused("on trigger input 1 .* 2.5 ms apart", edges, trigger_id=1)
    assert_refused("no rising trigger edge .* input 1: 20, input 3: 6; others: 26", edges, trigger_id=2)
    twice = together(pulses(STARTS, trigger_id=2), pulses(STARTS, trigger_id=3))
    assert_refused("rising edges on several inputs .input 2: 6, input 3: 6.; give --trigger-id", twice)


@pytest.mark.parametrize(
    "starts, sentence",
    [
        ([], "it holds no trigger edges"),
        ([5000], "one edge was seen"),
        (STARTS[:4], "saw 3 rounds from 0.007 s to 0.037 s but the ring made 5"),
        (np.arange(7) * ROUND_US, "saw 6 rounds .* but the ring made 5"),
        (
            STARTS * 2,
            "a round of the ring takes 10 ms but on trigger input 0 the rising edges are 20 ms apart",
        ),
        (np.delete(STARTS, [0, 2]), "saw 4 rounds"),
        (np.sort(np.r_[STARTS, 48_000 + 500 * np.arange(11)]), "has 11 edges too many"),
        (STARTS[[0, 1, 5]], "0 edges too many and 3 too few"),
    ],
)
def test_wrong_edges_are_refused(starts, sentence):
    assert_refused(sentence, pulses(starts))


def test_only_the_other_edge():
    edges = pulses(STARTS)
    falling = Edges(*(getattr(edges, name)[edges.p == 0] for name in ("p", "t", "id")))
    assert_refused(r"no rising trigger edge .*rising edges: none; others: 6.; check --trigger-id", falling)


def assert_refused(sentence, edges, **options):
    with pytest.raises(InputError, match=sentence) as caught:
        find_rounds(edges, log(), **options)
    assert str(caught.value).endswith(".") and "\n" not in str(caught.value)


# ---- hostile input ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes, sentence",
    [
        ({"format": "other"}, "its format is not"),
        ({"version": 2}, "its version is 2"),
        ({"order": []}, "order must list"),
        ({"order": [0, 1.5]}, "order must list"),
        ({"order": [0, True]}, "order must list"),
        ({"order": [-1, -1]}, "order must list"),
        ({"order": [0, 256]}, "order must list"),
        ({"order": "01"}, "order must list"),
        ({"slot_us": None}, "slot_us must be a finite number"),
        ({"slot_us": float("nan")}, "slot_us must be a finite number"),
        ({"slot_us": 0}, "slot_us is 0"),
        ({"crossfade": 1.5}, "crossfade is 1.5"),
        ({"rounds_done": 0, "ended": "stopped"}, "rounds_done is 0, so no round was completed"),
        ({"rounds_done": 2.5}, "rounds_done is 2.5"),
    ],
)
def test_wrong_ring_log(tmp_path, changes, sentence):
    path = tmp_path / "ring.json"
    path.write_text(json.dumps(LOG | changes))
    with pytest.raises(InputError, match=f"ring.json: {sentence}"):
        read_ring_log(path)


@pytest.mark.parametrize("text, sentence", [("", "not JSON"), ("[1]", "its format"), ("\xff{", "not JSON")])
def test_ring_log_of_another_kind(tmp_path, text, sentence):
    path = tmp_path / "ring.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=sentence):
        read_ring_log(path)


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
