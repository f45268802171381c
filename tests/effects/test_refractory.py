"""A refractory period that is told wrong."""

import numpy as np
import pytest

from evsdr.effects.refractory import Refractory
from evsdr.effects.shared import MODEL_US
from tests.support.shared_worlds import decision, found, world


def test_a_period_in_words_and_numbers():
    shared = found(refractory=0.3)
    assert Refractory().say(shared) == "300 +- 14 us"
    numbers = Refractory().numbers(shared)["refractory_us"]
    assert numbers == pytest.approx({"told_us": 50, "found_us": 300, "sigma_us": np.hypot(10, MODEL_US)})


def test_the_sensor_has_it():
    before = world()
    after = Refractory().model(before, decision(Refractory(), refractory=0.3))
    assert after.recording.sensor.refractory_us == pytest.approx(300)
    assert before.recording.sensor.refractory_us == 50
