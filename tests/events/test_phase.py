"""The phase of the ring by hand, by a round trip, and with drifting clocks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evsdr.errors import InputWarning
from evsdr.events.phase import phase, weights
from evsdr.records import Schedule
from tests.support.event_reference import led_weights

NO_TRIGGER = np.empty(0, np.int64)


def ring(order=(0, 1, 2, 3), slot_us=100.0, crossfade=0.5, start_us=0.0) -> Schedule:
    return Schedule(np.array(order, np.int32), slot_us, crossfade, start_us)


@pytest.mark.parametrize(
    "crossfade, expected",
    [
        (0.0, [0, 0, 0, 0, 1, 3, 0, 1]),
        (0.5, [0, 0, 0.5, 0.98, 1, 3.9, 0, 1.5]),
        (1.0, [0, 0.5, 0.75, 0.99, 1, 3.95, 0, 1.75]),
    ],
)
def test_phase_by_hand(crossfade, expected):
    at, inside = phase(np.array([0, 50, 75, 99, 100, 395, 400, 575]), ring(crossfade=crossfade), NO_TRIGGER)
    np.testing.assert_allclose(at, expected, rtol=0, atol=1e-12)
    assert at.dtype == np.float64 and inside.all()


@given(
    n_slot=st.integers(1, 30),
    slot_us=st.floats(1.0, 1e6),
    crossfade=st.floats(0.01, 1.0),
    start_us=st.floats(-1e9, 1e9),
    seed=st.integers(0, 2**32 - 1),
    drift=st.sampled_from((None, 0.0, 0.015, -0.015)),
)
def test_round_trip(n_slot, slot_us, crossfade, start_us, seed, drift):
    """From phases to times and back, by slot_us, or by triggers of a clock that drifts."""
    rng = np.random.default_rng(seed)
    schedule = ring(range(n_slot), slot_us, crossfade, start_us)
    slot, fade, lap = rng.integers(0, n_slot, 50), rng.uniform(0.01, 0.99, 50), rng.integers(0, 9, 50)
    position = lap * n_slot + slot + 1 - crossfade + crossfade * fade
    slot_us, triggers = slot_us * (1 + (drift or 0)), NO_TRIGGER
    if drift is not None:
        triggers = start_us + slot_us * n_slot * np.arange(10)
    at, inside = phase(start_us + slot_us * position, schedule, triggers)
    rounding = 1e-6 + 4 * np.spacing(abs(start_us) + slot_us * 10 * n_slot) / slot_us / crossfade
    np.testing.assert_allclose(at, slot + fade, rtol=0, atol=rounding)
    assert inside.all()


@pytest.mark.parametrize("crossfade", [0.0, 0.3, 1.0])
def test_weights_against_the_words_of_the_schedule(crossfade, rng):
    """Dark slots (-1), an LED in two slots, one after itself, one never lit."""
    order = [0, -1, 2, 2, 0, -1, -1, 4]
    t = rng.random(2000) * 3000
    expected = led_weights(t, order, 100.0, crossfade, 5)
    got = weights(t + 70, ring(order, crossfade=crossfade, start_us=70), 5, NO_TRIGGER)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)
    assert (expected.sum(axis=1) == 0).any() and (got[:, [1, 3]] == 0).all()


def test_drift_is_followed():
    """Rounds of 404, 396 and 3 x 400 us, where the schedule says 400 us: quarters stay quarters."""
    start = np.array([1000, 1404, 1800, 3000])
    t = np.array([1000, 1101, 1404, 1404 + 99, 1404 + 297, 1800 + 550, 2999, 3000])
    at, inside = phase(t, ring(crossfade=1.0), start)
    np.testing.assert_allclose(at, [0, 1, 0, 1, 3, 1.5, 3.99, 0], rtol=0, atol=1e-12)
    assert inside.all()


def test_a_trigger_is_a_slot_start_to_the_last_bit():
    """Hard switches: at every trigger the first LED is lit, never still the last."""
    start = np.cumsum(np.random.default_rng(3).integers(397, 404, 1000)) + 10**12
    at, inside = phase(start, ring(crossfade=0.0), start)
    assert (at == 0).all() and inside.all()


@pytest.mark.parametrize(
    "interval, fits", [(392, True), (408, True), (391, False), (409, False), (150, False)]
)
def test_intervals_that_are_not_whole_rounds(interval, fits):
    """2 % of 400 us are 8 us; outside of that slot_us counts from the trigger, for that interval only."""
    start = np.array([0, 400, 400 + interval, 800 + interval])
    t = np.array([100, 500, 400 + interval, 500 + interval])
    if fits:
        at, _ = phase(t, ring(crossfade=1.0), start)
    else:
        with pytest.warns(InputWarning, match="1 of 3 intervals between round-start triggers") as caught:
            at, _ = phase(t, ring(crossfade=1.0), start)
        assert len(caught) == 1 and caught[0].filename == __file__
    expected = [1, 400 / interval if fits else 1, 0, 1]
    np.testing.assert_allclose(at, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "triggers, inside", [([], [1, 1, 1, 1]), ([200], [0, 1, 1, 1]), ([200, 600], [0, 1, 1, 0])]
)
def test_inside(triggers, inside):
    t = np.array([199, 200, 600, 601])
    schedule = ring(start_us=100.0)
    at, got = phase(t, schedule, np.array(triggers, np.int64))
    np.testing.assert_array_equal(got, np.array(inside, bool))
    assert at[1] == (1 if not triggers else 0)
    assert not phase(np.array([99]), schedule, NO_TRIGGER)[1]
    got = weights(t, schedule, 4, np.array(triggers, np.int64))
    np.testing.assert_allclose(got.sum(axis=1), inside)


def test_one_trigger_runs_on():
    at, _ = phase(np.array([250, 1850]), ring(start_us=77.0, crossfade=1.0), np.array([200]))
    np.testing.assert_allclose(at, [0.5, 0.5], rtol=0, atol=1e-12)


@pytest.mark.parametrize("n_slot", [1, 3, 24])
def test_phase_stays_below_the_number_of_slots(n_slot, rng):
    """The last float before a round's end, and a time that is before the start by less than rounding."""
    for crossfade in rng.random(100):
        schedule = ring(range(n_slot), crossfade=crossfade)
        at, inside = phase(np.array([np.nextafter(100.0 * n_slot, 0), -1e-20]), schedule, NO_TRIGGER)
        assert n_slot - 1e-9 < at[0] < n_slot and at[1] == 0
        np.testing.assert_array_equal(inside, [True, False])


def test_any_shape():
    at, inside = phase(np.array([[0, 175], [100, 400]]), ring(), NO_TRIGGER)
    np.testing.assert_array_equal(at, [[0, 1.5], [1, 0]])
    assert inside.shape == (2, 2)
