"""A refractory period that is told wrong."""

from dataclasses import replace

import pytest

from evsdr.effects.refractory import Refractory
from tests.support.shared_worlds import decision, found, world


def test_a_period_in_words_and_numbers():
    shared = found(refractory=0.3)
    assert Refractory().say(shared) == "300 +- 10 us"
    numbers = Refractory().numbers(shared)["refractory_us"]
    assert numbers == pytest.approx({"told_us": 50, "found_us": 300, "sigma_us": 10})


def test_the_sensor_has_it():
    before = world()
    after = Refractory().model(before, decision(Refractory(), refractory=0.3))
    assert after.recording.sensor.refractory_us == pytest.approx(300)
    assert before.recording.sensor.refractory_us == 50


@pytest.mark.parametrize(("refractory", "warned"), [(0.3, True), (0.09, False)])
def test_a_period_told_wrong_is_warned_of(refractory, warned):
    """Told 50 us, to 15 us; beyond three times that it is worth a word."""
    sentence = Refractory().warning(found(refractory=refractory))
    assert sentence.startswith("refractory_us is told as 50 but the events say 300") == warned
    assert bool(sentence) == warned


def test_a_period_that_noise_can_make_is_no_warning():
    """What noise leaves in a reference is not known better than that, and said so."""
    shared = found(refractory=0.3)
    shared = replace(shared, inferred=replace(shared.inferred, lead=0.2))
    assert not Refractory().warning(shared)
    assert Refractory().numbers(shared)["refractory_us"]["sigma_us"] == pytest.approx(200, rel=0.01)
