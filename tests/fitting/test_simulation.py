"""Recordings simulated from Python: those of the command, with what is true of the scene."""

from dataclasses import replace

import numpy as np
import pytest

import evsdr
from evsdr.events.record import ring_schedule
from evsdr.files.truth import read_truth
from evsdr.fitting import simulation
from tests.support.small_scene import HEIGHT, WIDTH

IDEAL = evsdr.EventPixel().idealised()


def test_events_and_truth_are_those_of_the_command(place):
    """`place` holds what the command makes of its scene by --ideal --rounds 4."""
    recording, truth = evsdr.simulate(place / "scene.xml", IDEAL, rounds=4)
    written = evsdr.read_recording(place / "events.h5")
    for name in ("x", "y", "p", "t"):
        np.testing.assert_array_equal(getattr(recording.events, name), getattr(written.events, name))
    np.testing.assert_array_equal(recording.round_start_us, written.round_start_us)
    assert recording.sensor.contrast_threshold_on == written.sensor.contrast_threshold_on
    stored = read_truth(place / "truth.npz", HEIGHT, WIDTH, 2)
    for name in ("normal", "reflectance", "mask"):
        np.testing.assert_array_equal(getattr(truth, name), getattr(stored, name))


def test_a_schedule_and_a_seed_of_ones_own(place):
    ring = evsdr.load_scene(place / "scene.xml")
    schedule = ring_schedule(8, (0, -1, 3), slot_us=5000.0, crossfade=0.5)
    runs = [evsdr.simulate(ring, IDEAL, schedule, 2, seed)[0] for seed in (1, 1, 2)]
    assert runs[0].round_start_us.tolist() == [0, 15_000, 30_000]
    np.testing.assert_array_equal(runs[0].events.t, runs[1].events.t)
    assert not np.array_equal(runs[0].events.t, runs[2].events.t)
    assert runs[0].schedule is schedule


def test_what_the_recording_tells_of_thresholds(place):
    spread = replace(IDEAL, spread_on=0.05)
    for told, shape in (("calibrated", (HEIGHT, WIDTH)), ("nominal", ())):
        sensor = evsdr.simulate(place / "scene.xml", spread, rounds=1, thresholds=told)[0].sensor
        assert np.shape(sensor.contrast_threshold_on) == shape


def test_progress_goes_up(place):
    told = []
    evsdr.simulate(place / "scene.xml", IDEAL, rounds=1, progress=lambda *now: told.append(now))
    assert told[0] == ("render", 0.0) and told[-1] == ("events", 1.0)


@pytest.mark.parametrize(("change", "spp"), [({}, 16), ({"max_depth": 2}, 64)])
def test_noise_that_is_not_real_gets_more_rays(place, monkeypatch, change, spp):
    ring = evsdr.load_scene(place / "scene.xml")
    for name, value in change.items():
        monkeypatch.setattr(ring.integrator, name, value)
    used = []
    monkeypatch.setattr(
        "evsdr.light.tracing.led_images", lambda ring, spp, seed: used.append(spp) or np.zeros((8, 1, 1))
    )
    simulation.render(ring)
    simulation.render(ring, 3)
    assert used == [spp, 3]
