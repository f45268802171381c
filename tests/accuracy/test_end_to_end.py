"""The whole way from a scene to maps and their errors, by the commands."""

import json

import numpy as np
import pytest

from evsdr.commands import fit, simulate
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.files.events_h5 import write_recording
from evsdr.metrics import angular_error_deg
from evsdr.records import Recording, Schedule, Sensor
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals

SIZE = 32
NOISY = ["-D", f"size={SIZE}", "--ideal", "--pixel.event-noise", "0.1"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("accuracy")


def run_fit(scene, folder, name, *options):
    """Fit a recording; gives the summary and the maps."""
    out = folder / name
    truth = ["--truth", str(folder / "truth.npz")]
    events = str(folder / "events.h5")
    size = ["-D", f"size={SIZE}"]
    assert fit.main([f"scenes/{scene}.xml", events, "--out", str(out), *size, *truth, *options]) == 0
    return json.loads((out / "summary.json").read_text()), np.load(out / "maps.npz")


@pytest.mark.parametrize(("preset", "most_deg"), [("fast", 1.5), ("balanced", 1.5)])
def test_sphere(folder, preset, most_deg):
    if not (folder / "sphere").exists():
        assert simulate.main(["scenes/sphere.xml", "--out", str(folder / "sphere"), *NOISY]) == 0
    summary, _ = run_fit("sphere", folder / "sphere", preset, "--preset", preset)
    assert summary["model"]["cast shadows"].startswith("not modelled")
    assert summary["mae_deg"] <= most_deg
    assert summary["rmse"] <= 0.05


def test_cast_shadow_of_the_pole(folder):
    """Traced, as auto decides, the pole's shadow costs little; left out, much."""
    assert simulate.main(["scenes/sphere_pole.xml", "--out", str(folder / "pole"), *NOISY]) == 0
    truth = np.load(folder / "pole" / "truth.npz")
    from evsdr.effects.shadows import FACING
    from evsdr.light import scene, tracing

    ring = scene.load_scene("scenes/sphere_pole.xml", {"size": str(SIZE)})
    light, _ = tracing.trace_illumination(ring, 16, True)
    irradiance = np.array([e.numpy().reshape(SIZE, SIZE) for e in light.irradiance])
    cosine = np.einsum("hwk,jk->jhw", truth["normal"], ring_directions())
    shadow = ((irradiance < 0.99) & (cosine > FACING)).any(axis=0) & truth["mask"]
    assert 0.1 < shadow.sum() / truth["mask"].sum() < 0.5

    error = {}
    for shadows in ("auto", "off"):
        options = ("--shadows", shadows, "--preset", "fast", "--shared", "none")
        summary, maps = run_fit("sphere_pole", folder / "pole", shadows, *options)
        assert summary["effects"]["cast shadows"]["modelled"] == (shadows == "auto")
        angle = angular_error_deg(maps["normal"], truth["normal"])
        error[shadows] = angle[shadow].mean(), angle[truth["mask"] & ~shadow].mean()
    assert error["auto"][0] < 0.7  # shadows have edges; 0.3 outside
    assert error["off"][0] > 3 * error["auto"][0]


def test_light_computed_without_mitsuba(folder):
    """Recordings of an analytic sphere, made by NumPy alone, give the same accuracy: no inverse crime."""
    normal, mask = sphere_normals(SIZE)
    spectrum = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    signal = np.where(
        mask, lambert_signals(normal, np.broadcast_to(spectrum, (SIZE, SIZE, 8)), ring_directions()), 0
    )
    schedule = Schedule(np.arange(24), 20_000.0, 1.0)
    pixel = EventPixel(
        spread_on=0.0,
        spread_off=0.0,
        event_noise=0.1,
        cutoff_hz=0.0,
        photon_rate_per_us=0.0,
        leak_hz=0.0,
        hot_fraction=0.0,
    )
    events, _, _, starts = simulate_events(signal, 0.05, schedule, 6, pixel, seed=1)
    sensor = Sensor(
        SIZE, SIZE, pixel.contrast_threshold_on, pixel.contrast_threshold_off, pixel.refractory_us
    )
    analytic = folder / "analytic"
    analytic.mkdir()
    write_recording(analytic / "events.h5", Recording(events, sensor, schedule, starts))
    reflectance = np.broadcast_to(spectrum, (SIZE, SIZE, 8))
    np.savez(
        analytic / "truth.npz",
        normal=np.where(mask[..., None], normal, [0, 0, 1]),
        reflectance=reflectance,
        mask=mask,
    )
    summary, _ = run_fit("sphere", analytic, "fit", "--preset", "fast")
    assert summary["mae_deg"] <= 1.5
    assert summary["rmse"] <= 0.05
    assert summary["residual"]["relative_threshold_noise"] == pytest.approx(0.1, rel=0.1)


@pytest.mark.slow
def test_the_published_decoder_runs_to_its_end(folder):
    size = ["-D", "size=16"]
    assert simulate.main(["scenes/sphere.xml", "--out", str(folder), *NOISY, *size]) == 0
    options = ["--truth", str(folder / "truth.npz"), "--out", str(folder / "adam"), "--solver", "adam", *size]
    assert fit.main(["scenes/sphere.xml", str(folder / "events.h5"), *options]) == 0
    summary = json.loads((folder / "adam" / "summary.json").read_text())
    assert summary["numbers"]["steps"] == 1600
    assert summary["mae_deg"] < 10


def test_true_reflectance_is_the_integral_of_the_measured_spectra():
    """24 patches against brute force over a fine grid, closer than the renderer's four nodes come."""
    from evsdr.scenes.make_colorchecker import WAVELENGTH_NM, patch_spectra

    from evsdr.light import ground_truth, scene
    from evsdr.model import quadrature

    ring = scene.load_scene("scenes/colorchecker.xml", {"size": "96"})
    reflectance = ground_truth.surface_maps(ring, 1).reflectance
    spectrum = ring.leds.band_spectrum
    for patch in patch_spectra():
        fine = np.interp(quadrature.WAVELENGTH_NM, WAVELENGTH_NM, patch)
        band = quadrature.integrate(fine * spectrum) / quadrature.integrate(spectrum)
        assert np.abs(reflectance - band).max(axis=-1).min() < 2e-3
