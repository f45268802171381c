"""Dead and swapped LEDs are named by the events that contradict them, and mended."""

from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects.wiring import SUSPICIOUS, Fault, Wiring, find_fault, led_residuals
from evsdr.effects.world import Terms
from evsdr.errors import InputWarning
from evsdr.solve.recipes import Effort
from tests.support.sphere import errors, solve, sphere_recording
from tests.support.worlds import SmallWorld, problem_of

SIZE, NOISE = 32, {"event_noise": 0.1}


def test_a_sound_recording_raises_no_doubt():
    recording, light, _, mask = sphere_recording(SIZE, **NOISE)
    problem = problem_of(recording, light, mask)
    solution = solve(problem, Effort())
    assert led_residuals(problem.pairs, problem.illumination, solution).max() < 0.5 * (1 + SUSPICIOUS)
    assert find_fault(problem.pairs, problem.illumination, solution) is None


@pytest.mark.parametrize("fault", [Fault((5,)), Fault((3, 10)), Fault((7, 8))])
def test_dead_and_swapped_leds_are_named_and_mended(fault):
    dead = fault.leds if len(fault.leds) == 1 else ()
    recording, light, normal, mask = sphere_recording(SIZE, dead=dead, **NOISE)
    order = np.arange(24) if dead else fault.mend(np.arange(24))
    problem = problem_of(recording, light, mask, order)
    spoilt = solve(problem, Effort())
    found = find_fault(problem.pairs, problem.illumination, spoilt)
    assert found == fault
    mended = solve(problem_of(recording, light, mask, found.mend(order)), Effort())
    assert errors(mended, normal[mask])[0].mean() < 0.3 * errors(spoilt, normal[mask])[0].mean()
    assert errors(mended, normal[mask])[0].mean() < 1


def test_faults_are_also_found_while_thresholds_are_unknown():
    recording, light, _, mask = sphere_recording(SIZE, dead=(12,), **NOISE)
    problem = problem_of(recording, light, mask)
    assert find_fault(
        problem.pairs, problem.illumination, solve(problem, Effort(), thresholds=True)
    ) == Fault((12,))


def test_mending_an_order():
    order = np.array([0, 1, -1, 2, 1])
    np.testing.assert_array_equal(Fault((1,)).mend(order), [0, -1, -1, 2, -1])
    np.testing.assert_array_equal(Fault((1, 2)).mend(order), [0, 2, -1, 1, 2])
    assert str(Fault((1,))) == "LED 1 gives no light"
    assert str(Fault((1, 2))) == "LEDs 1 and 2 are swapped"


def test_a_fault_is_warned_of_and_mended():
    recording, light, _, mask = sphere_recording(SIZE, dead=(5,), **NOISE)
    problem = problem_of(recording, light, mask)
    fitted = SimpleNamespace(problem=problem, solution=solve(problem, Effort()))
    with pytest.warns(InputWarning, match="^the recording: LED 5 gives no light, say the events"):
        decision = Wiring().decide("auto", SmallWorld(recording), fitted)
    assert decision.modelled and decision.found == {"leds": [5]}
    order = Wiring().model(SmallWorld(recording), decision).recording.schedule.order
    np.testing.assert_array_equal(np.flatnonzero(order < 0), [5])


def test_adam_looks_for_no_fault():
    decision = Wiring().decide("auto", SmallWorld(None, terms=Terms(solver="adam")), None)
    assert not decision.modelled and "solver adam" in decision.why
