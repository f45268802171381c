"""Pixels that fire more than any light can make them count for nothing."""

import numpy as np

from evsdr.effects.hot_pixels import HotPixels, impossible_rate
from tests.support.sphere import SPECTRUM, sphere_recording
from tests.support.worlds import SmallWorld

SIZE, NOISE = 32, {"event_noise": 0.1}


def test_pixels_busier_than_any_surface_are_hot():
    recording, light, _, mask = sphere_recording(SIZE, hot_fraction=0.33, hot_hz=3000.0, **NOISE)
    hot = impossible_rate(recording, light)
    count = np.zeros((SIZE, SIZE))
    np.add.at(count, (recording.events.y, recording.events.x), 1)
    assert 0.25 < hot[mask].mean() < 0.4
    assert count[hot].min() > count[~hot].max()
    sound, light, _, _ = sphere_recording(SIZE, spectrum=np.ones_like(SPECTRUM), **NOISE)
    assert not impossible_rate(sound, light).any()


def test_hot_pixels_are_counted_and_left_out():
    recording, light, _, mask = sphere_recording(SIZE, hot_fraction=0.33, hot_hz=3000.0, **NOISE)
    world = SmallWorld(recording, light, mask)
    decision = HotPixels().decide("auto", world, None)
    hot = HotPixels().model(world, decision).hot
    assert decision.found == {"pixels": np.count_nonzero(hot & mask)}
    assert 0.25 < hot[mask].mean() < 0.4 and decision.why.startswith(f"{decision.found['pixels']}, whose")


def test_a_sound_recording_has_none():
    recording, light, _, mask = sphere_recording(SIZE, **NOISE)
    decision = HotPixels().decide("auto", SmallWorld(recording, light, mask), None)
    assert not decision.modelled and decision.why.startswith("none: ")
