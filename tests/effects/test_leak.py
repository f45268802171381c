"""A leak: what is said of it, and that pairs count it."""

import pytest

from evsdr.effects.leak import Leak
from evsdr.events.pairs import pair_events
from evsdr.solve.problem import make_problem
from tests.support.shared_worlds import FITTED, SLOT_US, decision, found, world
from tests.support.sphere import errors, solve, sphere_recording


def test_a_leak_in_words_and_numbers():
    """Of 1000 us slots: 2e-5 a slot are 0.02 a second."""
    shared = found(leak=2e-5)
    assert Leak().say(shared) == "log I seems to rise by 0.02 +- 10 a second"
    assert Leak().numbers(shared) == pytest.approx({"leak_per_s": 0.02, "leak_sigma_per_s": 10})


@pytest.mark.parametrize(("leak", "clear"), [(0.05, True), (-0.05, True), (0.03, False)])
def test_a_leak_must_be_clear(leak, clear):
    """Against 4 sigma of 0.01."""
    chosen = Leak().decide("auto", world(known=found(leak=leak)), FITTED)
    assert chosen.modelled == clear


def test_a_leak_found_is_the_worlds():
    before = world()
    after = Leak().model(before, decision(Leak(), leak=0.05))
    assert after.leak == pytest.approx(0.05 / SLOT_US) and before.leak == 0


def test_events_of_a_leak_are_mended():
    """Of 2 Hz, each a threshold of 0.2."""
    recording, light, normal, mask = sphere_recording(20, event_noise=0.02, leak_hz=2.0)
    pairs = [pair_events(recording, mask, leak=rise * 1e-6) for rise in (0.0, 0.4)]
    before, after = (
        errors(solve(make_problem(recording, of, light, mask)), normal[mask])[0].mean() for of in pairs
    )
    assert after < 0.7 * before
