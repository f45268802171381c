"""What speaks against what is told, and what does not."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.effects.doubts import SUSPICIOUS, Doubts, doubts_of, known_shape, led_residuals, suspects
from evsdr.effects.orientation import Bends
from evsdr.solve.recipes import Effort
from tests.support.setups import fitted_alone, recorded, scene_of
from tests.support.sphere import solve, sphere_recording
from tests.support.worlds import problem_of, world_of

CALM = Doubts(0.07, [], Bends(np.eye(4), 0), None, False, False, 0.7)


def residuals(order=None, **options):
    recording, light, _, mask = sphere_recording(32, event_noise=0.1, **options)
    problem = problem_of(recording, light, mask, order)
    return led_residuals(problem.pairs, problem.illumination, solve(problem, Effort()))


def test_a_sound_recording_raises_no_doubt():
    assert residuals().max() < 0.5 * (1 + SUSPICIOUS)
    doubts = doubts_of(*fitted_alone(scene_of(), recorded()[0]))
    assert (
        not doubts.events
        and not doubts.curl
        and not doubts.shape
        and doubts.shape_deg < 2
        and doubts.noise == pytest.approx(0.1, abs=0.03)
    )
    assert doubts.reflectance == pytest.approx(0.7, abs=0.15)


def test_times_of_leds_that_switch_speak_where_they_are_told_to_fade():
    recording = recorded("sphere", 0.0)[0]
    faded = replace(recording, schedule=replace(recording.schedule, crossfade=1.0))
    for told, switches in ((recording, False), (faded, True)):
        assert doubts_of(*fitted_alone(scene_of(), told)).switches == switches


def test_leds_that_are_dead_or_swapped_are_suspects():
    band = [j % 8 for j in range(24)]
    assert 5 in suspects(residuals(dead=(5,)), band)
    order = np.arange(24)
    order[[3, 10]] = 10, 3
    found = residuals(order)
    assert set(np.argsort(-found)[:2]) == {3, 10} and found.max() > SUSPICIOUS
    assert {3, 10} <= set(suspects(found, band))


def test_mates_of_the_worst_led_are_suspects():
    residual = np.ones(24)
    assert suspects(residual, [0] * 24) == []
    residual[[21, 1, 2, 3, 4, 6, 7]] = 9, 8, 7, 6, 5, 4, 3
    assert suspects(residual, [j % 8 for j in range(24)]) == [1, 2, 3, 4, 5, 6, 13, 21]
    assert len(suspects(residual, [0] * 24)) == 10


@pytest.mark.parametrize(
    ("change", "any_", "events", "bright"),
    [
        ({}, False, False, False),
        ({"noise": 0.2}, True, True, False),
        ({"suspects": [3]}, True, True, False),
        ({"curl": True}, True, False, False),
        ({"shape": True}, True, False, False),
        ({"noise": 0.078}, False, False, False),
        ({"noise": 0.078, "known": True}, True, False, False),
        ({"noise": 0.09}, True, False, False),
        ({"dark": True}, True, False, False),
        ({"switches": True}, True, False, False),
        ({"reflectance": 2.5}, True, False, True),
        ({"reflectance": 2.5, "noise": 0.3}, True, True, False),
    ],
)
def test_what_speaks(change, any_, events, bright):
    doubts = replace(CALM, **change)
    assert (doubts.any, doubts.events, doubts.bright) == (any_, events, bright)


def test_a_shape_that_is_flat_or_unknown_tells_no_turn():
    for name, known in (("sphere", True), ("colorchecker", False), ("relief_unknown", False)):
        assert (known_shape(world_of(scene_of(name))) is not None) == known


def test_nothing_is_known_of_events_that_pair_with_nothing():
    recording, light, _, mask = sphere_recording(16)
    problem = problem_of(recording, light, mask)
    solution = solve(problem, Effort())
    silent = replace(solution, noise_factor=np.full(problem.n_pixel, 100.0))
    assert not led_residuals(problem.pairs, problem.illumination, silent).any()
