"""Thresholds are unknown where a recording tells one value for all, and the solver can find them."""

from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects.thresholds import Thresholds
from evsdr.effects.world import Terms
from evsdr.records import Sensor


def world(on=0.2, solver="lm", constant_light=0.05):
    return SimpleNamespace(
        recording=SimpleNamespace(sensor=Sensor(4, 3, on, 0.3, 50.0)),
        ring=SimpleNamespace(constant_light=constant_light),
        terms=Terms(solver=solver),
    )


@pytest.mark.parametrize(
    ("asked", "given", "estimated", "words"),
    [
        ("auto", {}, True, "one value for all"),
        ("auto", {"on": np.full((3, 4), 0.2)}, False, "those of each pixel"),
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
