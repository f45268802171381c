"""Thresholds are unknown where a recording tells one value for all, and the solver can find them."""

from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects.thresholds import Thresholds, ThresholdScale, ThresholdsUnderVeil
from evsdr.effects.world import Terms
from evsdr.records import Sensor
from tests.support.shared_worlds import FITTED, decision, found
from tests.support.shared_worlds import world as shared_world


def world(on=0.2, solver="lm", constant_light=0.05, veil=None, tolerance=0.0):
    sensor = Sensor(4, 3, on, 0.3, 50.0, contrast_threshold_tolerance=tolerance)
    return SimpleNamespace(
        recording=SimpleNamespace(sensor=sensor),
        ring=SimpleNamespace(constant_light=constant_light),
        terms=Terms(solver=solver),
        veil=veil,
    )


@pytest.mark.parametrize(
    ("asked", "given", "estimated", "words"),
    [
        ("auto", {}, True, "one value for all"),
        ("auto", {"on": np.full((3, 4), 0.2)}, False, "those of each pixel"),
        ("auto", {"on": np.full((3, 4), 0.2), "tolerance": 0.02}, True, "were measured to 2.0%"),
        ("estimate", {"on": np.full((3, 4), 0.2)}, True, "--thresholds estimate"),
        ("known", {}, False, "--thresholds known"),
        ("estimate", {"solver": "adam"}, False, "solver adam"),
        ("estimate", {"constant_light": 0}, False, "without constant light"),
    ],
)
def test_who_tells_the_thresholds(asked, given, estimated, words):
    decision = Thresholds().decide(asked, world(**given), None)
    assert decision.modelled == estimated and words in decision.why
    assert decision.why.startswith("estimated per pixel: " if estimated else "as told: ")


def test_events_that_show_constant_light_can_tell_thresholds():
    assert ThresholdsUnderVeil().decide("auto", world(), None) is None
    assert ThresholdsUnderVeil().decide("auto", world(constant_light=0, veil=0.1), None).modelled


def test_thresholds_that_are_unknown_anyway_have_no_scale():
    assert ThresholdScale().decide("auto", shared_world(known=found(), thresholds=True), FITTED) is None
    assert ThresholdScale().decide("auto", shared_world(known=found()), FITTED).modelled


def test_a_scale_in_words_and_numbers():
    shared = found(log_threshold=np.log([1.2, 0.9]))
    assert ThresholdScale().say(shared) == "1.2 times the told C_on, 0.9 times the told C_off"
    numbers = ThresholdScale().numbers(shared)
    assert numbers["threshold_factor"] == pytest.approx([1.2, 0.9])
    assert numbers["threshold_factor_sigma"] == pytest.approx([0.012, 0.009])


def test_a_scale_multiplies_what_is_told():
    chosen = decision(ThresholdScale(), log_threshold=np.log([1.2, 0.9]))
    sensor = ThresholdScale().model(shared_world(), chosen).recording.sensor
    np.testing.assert_allclose(sensor.contrast_threshold_on, np.full((2, 2), 0.24), rtol=1e-6)
    assert sensor.contrast_threshold_off == pytest.approx(0.27)
