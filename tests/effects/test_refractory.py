"""A refractory period that the recording does not tell."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.effects.refractory import Refractory, find_refractory
from tests.support.sphere import sphere_recording
from tests.support.worlds import SmallWorld, problem_of

SIZE, NOISE = 32, {"event_noise": 0.1}


@pytest.mark.parametrize("true_us", [0.0, 300.0])
def test_the_refractory_period_is_found(true_us):
    recording, light, _, mask = sphere_recording(SIZE, refractory_us=true_us, **NOISE)
    untold = replace(recording, sensor=replace(recording.sensor, refractory_us=52.0))
    found, sigma = find_refractory(untold, problem_of(untold, light, mask), thresholds=False)
    assert found == pytest.approx(true_us, abs=2 * sigma)
    assert sigma < 100


def test_too_few_pixels_tell_no_refractory_period():
    recording, light, _, mask = sphere_recording(SIZE, **NOISE)
    few = np.zeros_like(mask)
    few[SIZE // 2, SIZE // 2 - 3 : SIZE // 2 + 3] = True
    assert find_refractory(recording, problem_of(recording, light, few), thresholds=False) is None


@pytest.mark.parametrize(
    ("asked", "guessed", "estimated"),
    [("auto", (), False), ("auto", ("refractory_us",), True), ("known", ("refractory_us",), False)],
)
def test_it_is_estimated_where_it_is_not_told(asked, guessed, estimated):
    recording, light, _, mask = sphere_recording(SIZE, refractory_us=300.0, **NOISE)
    recording = replace(recording, sensor=replace(recording.sensor, refractory_us=52.0, guessed=guessed))
    world = SmallWorld(recording, light, mask)
    decision = Refractory().decide(asked, world, None)
    report = decision.found["refractory_us"]
    assert decision.modelled == estimated == (report["found_us"] is not None)
    assert report["told_us"] == (None if guessed else 52.0)
    if estimated:
        assert Refractory().model(world, decision).recording.sensor.refractory_us == report["found_us"]
        assert report["found_us"] == pytest.approx(300, abs=2 * report["sigma_us"])
