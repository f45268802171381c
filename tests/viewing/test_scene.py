"""With a scene: swapped LEDs, a mirrored image, and what a fit can do at best."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.events.record import record
from evsdr.fitting.simulation import render
from evsdr.viewing.check import DOUBTFUL, FINE, WRONG
from evsdr.viewing.checks import examine
from evsdr.viewing.look import look_at
from tests.support.setups import PIXEL, scene_of
from tests.support.setups import recorded as recorded_scene
from tests.support.watched_files import watched


def answers(file, ring):
    look = look_at(file, ring)
    return look, {check.name: check for check in examine(look)}


@pytest.mark.slow
def test_a_scene_that_goes_with_its_recording():
    recording, truth = recorded_scene("sphere")
    look, found = answers(watched(recording), scene_of("sphere"))
    assert {check.state for check in found.values()} == {FINE}
    assert 0.05 < look.expected.normal_deg < 5
    sigma = look.fit.maps.normal_sigma_deg[look.fit.maps.mask & truth.mask]
    assert np.median(sigma) < 2 * look.expected.normal_deg  # neighbours help


def test_of_a_large_recording_a_part_is_fitted(monkeypatch):
    """As much of it as tells what all pixels share; that is asked about, and tells what to expect."""
    recording, _ = recorded_scene("sphere")
    for name, value in (("tiling.AT_ONCE", 200), ("tiles.ENOUGH", 150), ("tiles.BLOCK", 8)):
        monkeypatch.setattr(f"evsdr.fitting.{name}", value)
    monkeypatch.setattr("evsdr.fitting.story.solve_tiles", None)
    look, found = answers(watched(recording), scene_of("sphere"))
    fired = np.bincount(recording.events.y.astype(int) * recording.sensor.width + recording.events.x) > 0
    assert 50 < np.count_nonzero(look.fit.maps.mask) < 0.6 * np.count_nonzero(fired)
    assert found["scene"].state == FINE and 0.05 < look.expected.normal_deg < 5


@pytest.mark.slow
def test_a_mirrored_image():
    recording, _ = recorded_scene("sphere")
    events = replace(recording.events, x=(recording.sensor.width - 1 - recording.events.x).astype(np.uint16))
    look, found = answers(watched(replace(recording, events=events)), scene_of("sphere"))
    assert found["scene"].state == WRONG and look.expected is None
    assert "The image is mirrored in x" in str(found["scene"])


@pytest.mark.slow
def test_swapped_leds():
    ring = scene_of("sphere")
    signal, _ = render(ring)
    swapped = signal.copy()
    swapped[[3, 11]] = signal[[11, 3]]
    recording = record(
        swapped, ring.constant_light, PIXEL, recorded_scene("sphere")[0].schedule, 4, thresholds="nominal"
    )
    _, found = answers(watched(recording), ring)
    assert found["scene"].state == DOUBTFUL
    assert "LEDs 3 and 11 are swapped" in str(found["scene"])
