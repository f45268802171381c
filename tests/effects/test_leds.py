"""LEDs that shine otherwise than told: what is said, aimed, and warned of."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.effects.leds import LedDirections, LedPowers
from evsdr.effects.shared import Aim
from tests.support.shared_worlds import FITTED, decision, found, world

POWER, TILT = np.log([1.1, 0.9, 1.0]), np.radians([[1.0, 0.0], [0.0, 2.0], [0.0, 0.0]])


def test_powers_in_words_and_numbers():
    shared = found(log_power=POWER)
    assert LedPowers().say(shared).startswith("LED 1 is -10 % off, all 8.2 % on average")
    numbers = LedPowers().numbers(shared)
    assert numbers["power_factor"] == pytest.approx([1.1, 0.9, 1.0])
    assert numbers["power_factor_sigma"] == pytest.approx([0.011, 0.009, 0.01])


def test_directions_in_words_and_numbers():
    shared = found(tilt=TILT)
    assert LedDirections().say(shared) == "LEDs are 1 degrees off on average, 2 at most"
    numbers = LedDirections().numbers(shared)
    assert numbers["tilt_deg"][1] == pytest.approx([0, 2])
    assert np.ravel(numbers["tilt_sigma_deg"]) == pytest.approx(np.full(6, np.degrees(0.01)))


def test_powers_and_directions_add_up_to_one_aim():
    first = LedPowers().model(world(), decision(LedPowers(), log_power=POWER))
    np.testing.assert_array_equal(first.aim.log_power, POWER)
    assert not first.aim.tilt.any()
    both = LedDirections().model(first, decision(LedDirections(), tilt=TILT))
    np.testing.assert_array_equal(both.aim.log_power, POWER)
    np.testing.assert_array_equal(both.aim.tilt, TILT)
    again = LedPowers().model(both, decision(LedPowers(), log_power=-POWER))
    np.testing.assert_array_equal(again.aim.tilt, TILT)
    alone = LedDirections().model(world(), decision(LedDirections(), tilt=TILT))
    assert isinstance(alone.aim, Aim) and not alone.aim.log_power.any()


def test_powers_far_off_are_warned_of():
    """Beyond three times five percent."""
    sentence = LedPowers().warning(found(log_power=np.array([0.0, 0.2, -0.2])))
    assert sentence.startswith("LED powers differ from the scene's by up to 20 %") and "calibrate" in sentence
    assert "hardly better" not in sentence
    assert LedPowers().warning(found(log_power=np.array([0.0, 0.14, -0.14]))) == ""


def test_powers_in_doubt_are_said_to_be():
    known = found(log_power=np.array([0.0, 0.2, -0.2]))
    doubted = replace(known, inferred=replace(known.inferred, doubted=("powers",)))
    assert "as the events tell, which know them hardly better than told; calibrate" in LedPowers().warning(
        doubted
    )


def test_powers_that_tilt_or_gloss_may_be_are_warned_of():
    """However near to what is told: a plane looks one way."""
    near = found(log_power=np.array([0.0, 0.1, -0.1]))
    sentence = LedPowers().warning(replace(near, inferred=replace(near.inferred, doubted=("powers",))))
    assert "gloss" in sentence and "(by up to 10 %)" in sentence and LedPowers().warning(near) == ""


@pytest.mark.parametrize(("off", "modelled"), [(0.03, True), (0.015, False)])
def test_powers_that_hardly_differ_are_as_told(off, modelled):
    """However much they would turn normals: they are known to 0.01."""
    known = found(log_power=np.array([off, -off, off]))
    chosen = LedPowers().decide("auto", world(known=known), FITTED)
    assert chosen.modelled == modelled and ("too near" in chosen.why) != modelled


def test_directions_far_off_are_warned_of():
    """Beyond three times half a degree."""
    far = found(tilt=np.radians([[0.0, 1.6], [0.0, 0.0], [1.0, 0.0]]))
    sentence = LedDirections().warning(far)
    assert sentence.startswith(
        "LED directions differ from the scene's by up to 1.6 degrees, as the events tell; measure"
    )
    doubted = replace(far, inferred=replace(far.inferred, doubted=("directions",)))
    assert "hardly better" in LedDirections().warning(doubted)
    assert LedDirections().warning(found(tilt=np.radians([[0.0, 1.4], [1.0, 1.0], [0.0, 0.0]]))) == ""
