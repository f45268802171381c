"""LED powers and constant light from tilts of a white patch; thresholds from a flicker."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest

from evsdr.calibration.equations import collect_pairs, join, thin
from evsdr.calibration.patch import Patch, solve_powers
from evsdr.calibration.thresholds import flicker_schedule, log_waveform, measure_thresholds
from evsdr.commands import calibrate
from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.files.events_h5 import read_recording, write_recording
from evsdr.light.scene import load_scene
from evsdr.records import Recording, Schedule, Sensor
from tests.support.analytic import ring_directions
from tests.support.small_scene import leds, scene

LIGHT, WHITE, SIDE = 0.05, 0.99, 6
QUIET = EventPixel().idealised()
NOISY = replace(QUIET, spread_on=0.02, spread_off=0.02)
WITH_DARK = tuple(k for j in range(24) for k in (j, -1))


@pytest.fixture(autouse=True)
def few_pairs(monkeypatch):
    """Enough for the accuracy asked for, and quick."""
    monkeypatch.setattr("evsdr.calibration.equations.MOST_PAIRS", 10_000)


def tilt(polar_deg: float, azimuth_deg: float) -> np.ndarray:
    polar, azimuth = np.radians([polar_deg, azimuth_deg])
    return np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])


TILTS = [tilt(10, 0), tilt(30, 0), tilt(30, 120), tilt(30, 240)]


def record_patch(
    direction, power, normal, order, seed, rounds=1, pixel=NOISY, shape=(SIDE, SIDE)
) -> Recording:
    """Let pixels look at a flat patch; a frame of one pixel around it stays dark."""
    signal = np.zeros((len(power), *shape))
    value = WHITE * power * np.maximum(direction @ normal, 0)
    signal[:, 1:-1, 1:-1] = value[:, None, None]
    schedule = Schedule(np.array(order, np.int32), 20_000.0, 1.0)
    events, on, off, starts = simulate_events(signal, LIGHT, schedule, rounds, pixel, seed)
    return Recording(events, Sensor(shape[1], shape[0], on, off, 52.0), schedule, starts)


def solve(tilts, order, power, told=None, tilt_sigma_deg=0.3, pixel=NOISY):
    direction = ring_directions()
    mask = np.zeros((SIDE, SIDE), bool)
    mask[1:-1, 1:-1] = True
    parts, patches = [], []
    for k, normal in enumerate(tilts):
        recording = record_patch(direction, power, normal, order, seed=k, pixel=pixel)
        parts.append(collect_pairs(recording, mask, np.full(mask.shape, k)))
        patches.append(Patch((told or tilts)[k], direction[:, None], np.full((24, 1), WHITE)))
    return solve_powers(patches, thin(join(parts), 0), np.ones(24), 0.2, tilt_sigma_deg)


@pytest.mark.parametrize("order", [WITH_DARK, tuple(range(24))], ids=["dark slots", "no dark slots"])
def test_powers_within_one_percent_and_constant_light_within_two(rng, order):
    power = rng.uniform(0.7, 1.3, 24)
    tilts = TILTS if order is WITH_DARK else [tilt(45, a) for a in (0, 90, 180, 270)]
    found = solve(tilts, order, power)
    relative = power / power.mean()
    assert np.abs(found.power / relative - 1).max() < 0.01
    assert found.constant_light == pytest.approx(LIGHT / power.mean(), rel=0.02)
    assert found.power.mean() == pytest.approx(1.0, rel=1e-9)
    z = (found.power - relative) / found.power_sigma
    assert np.sqrt(np.mean(z**2)) < 3.5 and found.power_sigma.max() < 0.01


def test_tilts_told_wrong_are_refined(rng):
    """Each tilt told 1.5 degrees wrong; without freedom the powers would be off by more than one percent."""
    power = rng.uniform(0.7, 1.3, 24)
    told = [n + [np.radians(1.5), 0, 0] for n in TILTS]
    told = [n / np.linalg.norm(n) for n in told]
    found = solve(TILTS, WITH_DARK, power, told, tilt_sigma_deg=1.5)
    stiff = solve(TILTS, WITH_DARK, power, told, tilt_sigma_deg=0.0)
    error, stiff_error = (np.abs(f.power / power * power.mean() - 1).max() for f in (found, stiff))
    assert error < 0.01 < stiff_error
    assert np.degrees(np.arccos(np.sum(found.normal * TILTS, axis=1))).max() < 0.3


def test_one_tilt_without_dark_slots_is_refused():
    """One ratio too few: 24 powers and C_w, all tilts alike."""
    fine = EventPixel(0.05, 0.05).idealised()
    with pytest.raises(
        InputError, match="the tilts don't tell .* two tilts at least, 15 degrees or more apart"
    ):
        solve([tilt(30, 20)] * 2, tuple(range(24)), np.linspace(0.5, 1.5, 24), tilt_sigma_deg=0.0, pixel=fine)


def test_tilts_that_hardly_differ_are_refused():
    """Less apart than they are known: C_w would have a sigma of more than half of it."""
    fine = EventPixel(0.05, 0.05).idealised()
    with pytest.raises(InputError, match="two tilts at least"):
        tilts = [tilt(30, 20), tilt(30.25, 20)]
        solve(tilts, tuple(range(24)), np.linspace(0.5, 1.5, 24), tilt_sigma_deg=5.0, pixel=fine)


def test_noise_of_the_thresholds_does_not_bias_c_w(monkeypatch):
    """Ten percent: plain least squares makes C_w two to three percent too large."""
    monkeypatch.setattr("evsdr.calibration.equations.MOST_PAIRS", 30_000)
    noisy = replace(NOISY, event_noise=0.1)
    found = solve(TILTS, WITH_DARK, np.ones(24), pixel=noisy)
    assert found.constant_light == pytest.approx(LIGHT, rel=0.012)


def test_an_led_that_no_tilt_sees_is_refused():
    with pytest.raises(InputError, match="no tilt shows LED 9 to the patch"):
        solve([tilt(70, 0), tilt(60, 0)], WITH_DARK, np.ones(24))


@pytest.fixture(scope="module")
def patches(tmp_path_factory):
    """A scene with eight LEDs of equal power, and recordings of tilts under LEDs that are not."""
    folder = tmp_path_factory.mktemp("patch")
    (folder / "scene.xml").write_text(scene(light=leds(8)))
    power = np.linspace(0.8, 1.2, 8)
    for k, normal in enumerate(TILTS):
        order = [i for j in range(8) for i in (j, -1)]
        recording = record_patch(ring_directions(8), power, normal, order, k, shape=(12, 16))
        write_recording(folder / f"tilt_{k}.h5", recording)
    few = record_patch(ring_directions(8), power, TILTS[1], [0, -1, 1, -1], 0, shape=(12, 16))
    write_recording(folder / "few.h5", few)
    return folder, power


def tilt_arguments(folder) -> list[str]:
    return [f"{folder}/tilt_{k}.h5:{','.join(f'{c:.6f}' for c in n)}" for k, n in enumerate(TILTS)]


def test_powers_command_writes_a_rig_that_sets_c_w(patches, tmp_path):
    folder, power = patches
    out = tmp_path / "out"
    arguments = ["powers", str(folder / "scene.xml"), *tilt_arguments(folder), "--out", str(out)]
    assert calibrate.main([*arguments, "--tilt-sigma-deg", "0.1"]) == 0
    assert {f.name for f in out.iterdir()} == {"rig.xml", "calibration.json", "residuals.png"}
    said = json.loads((out / "calibration.json").read_text())
    text = scene(light="").replace("<default", '<include filename="out/rig.xml"/><default', 1)
    (tmp_path / "scene.xml").write_text(text)
    ring = load_scene(tmp_path / "scene.xml")
    assert ring.constant_light == pytest.approx(LIGHT, rel=0.02)
    assert ring.constant_light == pytest.approx(said["constant_light"]["value"], rel=1e-5)
    np.testing.assert_allclose(ring.leds.power, power, rtol=0.01)
    assert 0 < said["constant_light"]["sigma"] < 0.02 * LIGHT
    assert all(0 < led["sigma"] < 0.01 for led in said["leds"])


@pytest.mark.parametrize(
    "patch, says",
    [
        ("{}/tilt_0.h5", "write a patch as events.h5:nx,ny,nz"),
        ("{}/tilt_0.h5:0,0,-1", "nz above 0"),
        ("{}/none.h5:0,0,1", "no such file"),
        ("{}/few.h5:0,0,1", "lights 2 LEDs but"),
        ("{}/tilt_0.h5:0,0,1:{}/mask.npy", "no pixel sees the patch"),
    ],
)
def test_patches_that_can_not_be_used_are_refused(patches, tmp_path, capsys, patch, says):
    folder, _ = patches
    np.save(folder / "mask.npy", np.zeros((12, 16), np.uint8))
    arguments = ["powers", str(folder / "scene.xml"), patch.replace("{}", str(folder))]
    assert calibrate.main([*arguments, "--out", str(tmp_path / "out")]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


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
    with h5py.File(out / "thresholds.h5") as file:
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
