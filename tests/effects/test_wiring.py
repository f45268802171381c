from dataclasses import replace

import numpy as np
import pytest

from evsdr.effects.hot_pixels import impossible_rate
from evsdr.effects.refractory import find_refractory
from evsdr.effects.wiring import SUSPICIOUS, Fault, find_fault, led_residuals
from evsdr.events.pairs import pair_events
from evsdr.solve import levenberg
from evsdr.solve.problem import make_problem
from tests.support.sphere import SPECTRUM, errors, solve, sphere_recording

SIZE, NOISE = 32, {"event_noise": 0.1}


def problem_of(recording, light, mask, order=None):
    if order is not None:
        recording = replace(recording, schedule=replace(recording.schedule, order=order))
    return make_problem(recording, pair_events(recording, mask), light, mask)


def test_a_sound_recording_raises_no_doubt():
    recording, light, _, mask = sphere_recording(SIZE, **NOISE)
    problem = problem_of(recording, light, mask)
    solution = solve(problem, levenberg.Effort())
    assert led_residuals(problem.pairs, problem.illumination, solution).max() < 0.5 * (1 + SUSPICIOUS)
    assert find_fault(problem.pairs, problem.illumination, solution) is None


@pytest.mark.parametrize("fault", [Fault((5,)), Fault((3, 10)), Fault((7, 8))])
def test_dead_and_swapped_leds_are_named_and_mended(fault):
    dead = fault.leds if len(fault.leds) == 1 else ()
    recording, light, normal, mask = sphere_recording(SIZE, dead=dead, **NOISE)
    order = np.arange(24) if dead else fault.mend(np.arange(24))
    problem = problem_of(recording, light, mask, order)
    spoilt = solve(problem, levenberg.Effort())
    found = find_fault(problem.pairs, problem.illumination, spoilt)
    assert found == fault
    mended = solve(problem_of(recording, light, mask, found.mend(order)), levenberg.Effort())
    assert errors(mended, normal[mask])[0].mean() < 0.3 * errors(spoilt, normal[mask])[0].mean()
    assert errors(mended, normal[mask])[0].mean() < 1


def test_faults_are_also_found_while_thresholds_are_unknown():
    recording, light, _, mask = sphere_recording(SIZE, dead=(12,), **NOISE)
    problem = problem_of(recording, light, mask)
    assert find_fault(
        problem.pairs, problem.illumination, solve(problem, levenberg.Effort(), thresholds=True)
    ) == Fault((12,))


def test_mending_an_order():
    order = np.array([0, 1, -1, 2, 1])
    np.testing.assert_array_equal(Fault((1,)).mend(order), [0, -1, -1, 2, -1])
    np.testing.assert_array_equal(Fault((1, 2)).mend(order), [0, 2, -1, 1, 2])
    assert str(Fault((1,))) == "LED 1 gives no light"
    assert str(Fault((1, 2))) == "LEDs 1 and 2 are swapped"


def test_pixels_busier_than_any_surface_are_hot():
    recording, light, _, mask = sphere_recording(SIZE, hot_fraction=0.33, hot_hz=3000.0, **NOISE)
    hot = impossible_rate(recording, light)
    count = np.zeros((SIZE, SIZE))
    np.add.at(count, (recording.events.y, recording.events.x), 1)
    assert 0.25 < hot[mask].mean() < 0.4
    assert count[hot].min() > count[~hot].max()
    sound, light, _, _ = sphere_recording(SIZE, spectrum=np.ones_like(SPECTRUM), **NOISE)
    assert not impossible_rate(sound, light).any()


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
