"""The table of faults: each is put into a recording, and found."""

from types import SimpleNamespace

import pytest

from experiments.view_faults import FAULTS, Bench, found
from tests.support.watched_files import CONSTANT_LIGHT, ball_signal

EXPECTED = {
    "LED 7 is dead": "doubtful: LEDs",
    "the last trigger is missing": "doubtful: triggers",
    "light of 120 Hz, slots of 10 ms": "doubtful: room light",
    "slots told 10 times too long": "contradicted: schedule",
}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_fault_is_found(name, tmp_path):
    bench = Bench(SimpleNamespace(constant_light=CONSTANT_LIGHT), ball_signal())
    fault = next(fault for fault in FAULTS if fault.name == name)
    assert found(bench, fault, tmp_path) == EXPECTED[name]
