"""Contrast thresholds of each pixel from a flicker."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest

from evsdr.calibration.thresholds import flicker_schedule, log_waveform, measure_thresholds
from evsdr.commands import calibrate
from evsdr.events.pixel import EventPixel
from evsdr.events.record import FLICKER_ROUNDS, FLICKER_US, flicker_order, record, ring_schedule
from evsdr.events.simulator import simulate_events
from evsdr.files.events_h5 import read_recording, write_recording
from evsdr.records import Recording, Schedule, Sensor
from tests.support.white_patches import QUIET

N_STEP, PERIOD_US = 64, 400_000.0


def record_flicker(pixel: EventPixel, rounds: int = 20) -> tuple[Recording, np.ndarray, np.ndarray]:
    """Let pixels see exp(sin), drawn by a ring of 64 lights that fade into each other."""
    wave = np.exp(np.sin(2 * np.pi * np.arange(N_STEP) / N_STEP))
    signal = np.broadcast_to(0.3 * wave[:, None, None], (N_STEP, 8, 10))
    ring = Schedule(np.arange(N_STEP, dtype=np.int32), PERIOD_US / N_STEP, 1.0)
    events, on, off, starts = simulate_events(signal, 0.0, ring, rounds, pixel, seed=2)
    schedule = Schedule(np.zeros(1, np.int32), PERIOD_US, 1.0)
    return Recording(events, Sensor(10, 8, 0.25, 0.38, 52.0), schedule, starts), on, off


@pytest.fixture(scope="module")
def flicker():
    return record_flicker(replace(QUIET, spread_on=0.05, spread_off=0.04))


def test_thresholds_within_two_percent(flicker):
    recording, on, off = flicker
    found = measure_thresholds(
        recording, log_waveform("sine-log", 2.0), flicker_schedule(recording, None, None)
    )
    for one, truth in zip(found, (on, off)):
        assert one.known.all() and np.abs(one.value / truth - 1).max() < 0.02
        z = (one.value - truth) / one.sigma
        assert 0.7 < np.sqrt(np.mean(z**2)) < 1.8
        assert one.noise == pytest.approx(0.02, rel=0.2)


def test_a_hot_pixel_has_no_threshold_of_its_own():
    recording, on, _ = record_flicker(replace(QUIET, event_noise=0.0, hot_fraction=0.1, hot_hz=300.0), 5)
    schedule = flicker_schedule(recording, None, None)
    found, _ = measure_thresholds(recording, log_waveform("sine-log", 2.0), schedule)
    count = np.zeros(on.shape, int)
    np.add.at(count, (recording.events.y, recording.events.x), 1)
    hot = count > 2 * np.median(count)
    assert 0 < hot.sum() < 20
    np.testing.assert_array_equal(found.known, ~hot)
    np.testing.assert_allclose(found.value, on, rtol=0.02)


def test_waveforms(tmp_path):
    at = np.linspace(0, 1, 4097)
    triangle = log_waveform("triangle-log", 2.0)
    np.testing.assert_allclose(triangle[[0, 1024, 2048, 3072, 4096]], [0, 1, 0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(log_waveform("sine", 0.5), np.log1p(0.5 * np.sin(2 * np.pi * at)), atol=1e-12)
    (tmp_path / "wave.csv").write_text("phase,intensity\n0,1\n0.25,2\n0.5,1\n0.75,0.5\n")
    found = log_waveform(str(tmp_path / "wave.csv"), 1.0)
    np.testing.assert_allclose(found[[0, 1024, 3584]], [0, np.log(2), np.log(0.5) / 2], atol=1e-12)


def test_thresholds_command_applies_them_to_a_recording(flicker, tmp_path):
    recording, on, off = flicker
    write_recording(tmp_path / "flicker.h5", recording)
    write_recording(tmp_path / "ring.h5", recording)
    out = tmp_path / "out"
    arguments = ["thresholds", str(tmp_path / "flicker.h5"), "--apply", str(tmp_path / "ring.h5")]
    assert calibrate.main([*arguments, "--out", str(out)]) == 0
    applied = read_recording(out / "ring.h5").sensor
    np.testing.assert_allclose(applied.contrast_threshold_on, on, rtol=0.02)
    np.testing.assert_allclose(applied.contrast_threshold_off, off, rtol=0.02)
    assert applied.contrast_threshold_tolerance == 0.02
    with h5py.File(out / "thresholds.h5") as file:
        assert file["sensor"].attrs["contrast_threshold_tolerance"] == 0.02
        np.testing.assert_array_equal(file["sensor/contrast_threshold_on"][()], applied.contrast_threshold_on)
        assert (file["sensor/contrast_threshold_on_sigma"][()] > 0).all()
    said = json.loads((out / "calibration.json").read_text())
    assert said["contrast_threshold_on"]["pixels_known"] == 80
    assert (out / "residuals.png").stat().st_size > 1000


@pytest.mark.parametrize(
    "arguments, says",
    [
        ([], "no trigger edges"),
        (["--start-us", "0", "--depth", "0"], "--depth is 0"),
        (["--start-us", "0", "--waveform", "square"], "neither one of sine-log"),
        (["--start-us", "200000"], "polarity that the waveform forbids"),
        (["--start-us", "0", "--period-us", "0"], "--period-us is 0"),
        (["--start-us", "0", "--apply", "none.h5"], "there is no such file"),
    ],
)
def test_flickers_that_can_not_be_used_are_refused(flicker, tmp_path, capsys, arguments, says):
    recording = replace(flicker[0], round_start_us=np.empty(0, np.int64))
    write_recording(tmp_path / "flicker.h5", recording)
    out = tmp_path / "out"
    assert calibrate.main(["thresholds", str(tmp_path / "flicker.h5"), "--out", str(out), *arguments]) == 2
    assert says in capsys.readouterr().err
    assert not out.exists()


def test_the_rings_own_flicker_tells_thresholds_of_an_evk4(tmp_path):
    """Depth is not told; told as 19 % apart, thresholds are found within 2 %, but for 2.5 % by noise and lag."""
    signal = np.random.default_rng(0).uniform(0.4, 1, (1, 8, 10))
    schedule = ring_schedule(1, flicker_order((0,)), FLICKER_US)
    recording = record(signal, 0.06, EventPixel(hot_fraction=0), schedule, FLICKER_ROUNDS)
    nominal = replace(recording.sensor, contrast_threshold_on=0.25, contrast_threshold_off=0.38)
    write_recording(tmp_path / "f.h5", replace(recording, sensor=nominal))
    arguments = ["thresholds", str(tmp_path / "f.h5"), "--waveform", "ring", "--out", str(tmp_path / "out")]
    assert calibrate.main(arguments) == 0
    told = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert told["flicker"]["depth_of_log_intensity_median"] == pytest.approx(np.log1p(0.7 / 0.06), rel=0.03)
    with h5py.File(tmp_path / "out" / "thresholds.h5") as file:
        for name in ("contrast_threshold_on", "contrast_threshold_off"):
            found, sigma = (file[f"sensor/{name}{end}"][()] for end in ("", "_sigma"))
            ratio = found / getattr(recording.sensor, name)
            assert ratio.std() < 0.02 and abs(ratio.mean() - 1) < 0.045
            assert np.sqrt(np.mean(((found - getattr(recording.sensor, name)) / sigma) ** 2)) < 2


def test_a_ring_is_no_flicker(tmp_path, flicker, capsys):
    recording, *_ = flicker
    write_recording(tmp_path / "f.h5", recording)
    arguments = ["thresholds", str(tmp_path / "f.h5"), "--waveform", "ring", "--out", str(tmp_path / "out")]
    assert calibrate.main(arguments) == 2
    assert "record one by python -m evsdr.capture --flicker" in capsys.readouterr().err
