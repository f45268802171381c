"""How long a round takes: by events that repeat, and by triggers that jitter."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.events.period import find_period, unevenness
from evsdr.events.pixel import EventPixel
from evsdr.events.record import record, ring_schedule


@pytest.fixture(scope="module")
def recording():
    """Give 12 x 12 pixels that see eight LEDs, each its own way, for six rounds; no triggers."""
    signal = np.random.default_rng(0).uniform(0.02, 1, (8, 12, 12))
    made = record(signal, 0.1, replace(EventPixel(), hot_fraction=0.0), ring_schedule(8), 6)
    return replace(made, round_start_us=np.empty(0, np.int64))


def told(recording, factor):
    """Tell slots of another length."""
    schedule = replace(recording.schedule, slot_us=factor * recording.schedule.slot_us)
    return replace(recording, schedule=schedule)


@pytest.mark.parametrize("off", [0, 1e-3, -5e-3, 15e-3])
def test_events_tell_how_long_a_round_takes(recording, off):
    found = find_period(told(recording, 1 - off))
    assert found.sigma < 150e-6
    assert abs(found.ratio * (1 - off) - 1) < 3 * found.sigma


def test_a_slow_start_and_other_units_do_not_matter(recording):
    events = replace(recording.events, t=recording.events.t + 77_000)
    late = replace(recording, events=events, schedule=replace(recording.schedule, start_us=77_000.0))
    assert find_period(late) == find_period(recording)


def test_what_does_not_repeat_tells_nothing(recording, rng):
    e = recording.events
    other = rng.permutation(len(e))
    t = np.sort(rng.integers(0, e.t[-1], len(e)))
    assert find_period(replace(recording, events=replace(e, x=e.x[other], y=e.y[other], t=t))) is None
    one_round = e.t < 8 * 20_000
    short = replace(e, **{name: getattr(e, name)[one_round] for name in "xypt"})
    assert find_period(replace(recording, events=short)) is None


def test_unevenness_is_that_of_a_time(rng):
    number = np.cumsum(rng.integers(1, 3, 4000))
    times = 1e4 * number + 1e-4 * number**2
    assert np.abs(unevenness(number, times)).max() < 1
    assert unevenness(number, times + rng.normal(0, 300, 4000)).std() == pytest.approx(300, rel=0.05)
