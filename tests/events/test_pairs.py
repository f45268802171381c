"""Event pairs against a brute-force twin and by hand."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.errors import InputError, InputWarning
from evsdr.events.pairs import pair_events
from evsdr.events.phase import phase
from evsdr.records import Events, Recording, Schedule, Sensor

WIDTH, HEIGHT = 7, 5


def record(x, y, p, t, refractory_us=10.0, order=(0, 1, 2, 3), slot_us=100.0, crossfade=0.0, rounds=()):
    types = (np.uint16, np.uint16, np.int8, np.int64)
    events = Events(*(np.asarray(values, dtype) for values, dtype in zip((x, y, p, t), types)))
    sensor = Sensor(WIDTH, HEIGHT, 0.1, 0.1, refractory_us)
    schedule = Schedule(np.asarray(order, np.int32), slot_us, crossfade)
    return Recording(events, sensor, schedule, np.asarray(rounds, np.int64))


def one_pixel(p, t, **kwargs):
    return record(np.full(len(t), 3), np.full(len(t), 2), p, t, **kwargs)


@pytest.fixture
def recording() -> Recording:
    """Random events, some before the first round, some after the last, some pixels without any."""
    rng = np.random.default_rng(7)
    n_event = 2000
    pixel = rng.choice(WIDTH * HEIGHT // 2, n_event) * 2
    t = np.sort(rng.integers(0, 30_000, n_event))
    p = rng.integers(0, 2, n_event)
    rounds = [2000, 2404, 2804, 20_010]
    return record(pixel % WIDTH, pixel // WIDTH, p, t, refractory_us=12.5, crossfade=0.4, rounds=rounds)


def twin(recording, mask):
    """Pair events one by one."""
    events, refractory_us = recording.events, recording.sensor.refractory_us
    pairs, n_event, n_dropped = [], 0, 0
    for y in range(HEIGHT):
        for x in range(WIDTH):
            here = [k for k in range(len(events)) if (events.x[k], events.y[k]) == (x, y) and mask[y, x]]
            n_event += len(here)
            for first, second in zip(here, here[1:]):
                start, end = events.t[first] + refractory_us, float(events.t[second])
                if start - 1 <= end < start:
                    start = end
                at, inside = phase(np.array([start, end]), recording.schedule, recording.round_start_us)
                if end < start or not inside.all():
                    n_dropped += 1
                else:
                    pairs.append((y * WIDTH + x, *at, 1 if events.p[second] else -1))
    return np.array(pairs), n_event, n_dropped


@pytest.mark.filterwarnings("ignore:.*refractory_us.*")
@pytest.mark.parametrize("masked", [False, True])
def test_brute_force_twin(recording, masked, monkeypatch):
    monkeypatch.setattr("evsdr.events.pairs.CHUNK", 301)  # several chunks
    mask = np.random.default_rng(1).random((HEIGHT, WIDTH)) < (0.6 if masked else 1)
    expected, n_event, n_dropped = twin(recording, mask)
    pairs = pair_events(recording, mask if masked else None)
    assert len(expected) > 300 and n_dropped > 100
    assert (pairs.n_event, pairs.n_dropped) == (n_event, n_dropped)
    pixel = np.repeat(np.arange(HEIGHT * WIDTH), np.diff(pairs.offset.astype(np.int64)))
    np.testing.assert_array_equal(pixel, expected[:, 0])
    np.testing.assert_array_equal(pairs.phase_start, expected[:, 1].astype(np.float32))
    np.testing.assert_array_equal(pairs.phase_end, expected[:, 2].astype(np.float32))
    np.testing.assert_array_equal(pairs.polarity, expected[:, 3])
    assert pairs.offset.shape == (HEIGHT * WIDTH + 1,)
    types = [a.dtype for a in (pairs.offset, pairs.phase_start, pairs.phase_end, pairs.polarity)]
    assert types == [np.uint32, np.float32, np.float32, np.int8]


def test_by_hand():
    """Two pixels, crossfade over the second half of each slot of 100 us, refractory period 10 us."""
    recording = record(
        x=[3, 1, 3, 1, 3], y=[2, 0, 2, 0, 2], p=[1, 1, 0, 1, 1], t=[10, 20, 60, 175, 385], crossfade=0.5
    )
    pairs = pair_events(recording)
    pixel = np.flatnonzero(np.diff(pairs.offset.astype(int)))
    np.testing.assert_array_equal(pixel, [0 * WIDTH + 1, 2 * WIDTH + 3])
    np.testing.assert_allclose(pairs.phase_start, [0.0, 0.0, 0.4], atol=1e-7)
    np.testing.assert_allclose(pairs.phase_end, [1.5, 0.2, 3.7], rtol=1e-7)
    np.testing.assert_array_equal(pairs.polarity, [1, -1, 1])
    assert (pairs.n_event, pairs.n_dropped) == (5, 0)


def test_pixels_without_events_are_empty():
    offset = pair_events(one_pixel([1, 0], [0, 150])).offset
    np.testing.assert_array_equal(offset, np.arange(WIDTH * HEIGHT + 1) > 2 * WIDTH + 3)


def test_events_outside_of_the_rounds_are_dropped():
    """Rounds run from 1000 to 1800 us; pairs that start before or end after them are dropped."""
    recording = one_pixel([1, 0] * 3, [900, 995, 1150, 1350, 1795, 1850], rounds=[1000, 1400, 1800])
    pairs = pair_events(recording)
    assert (len(pairs.polarity), pairs.n_dropped) == (3, 2)
    np.testing.assert_array_equal(pairs.phase_start, [0, 1, 3])
    np.testing.assert_array_equal(pairs.phase_end, [1, 3, 3])


@pytest.mark.parametrize("gap, kept", [(12, True), (11, True), (10, False)])
@pytest.mark.filterwarnings("ignore:.*refractory_us")
def test_pairs_closer_than_the_refractory_period(gap, kept):
    """Refractory period 11.7 us: 11 us later is within the rounding of times, 10 us is not."""
    times = [0, 100, 100 + gap, 300]
    pairs = pair_events(one_pixel([1, 1, 1, 1], times, refractory_us=11.7))
    assert (len(pairs.polarity), pairs.n_dropped) == ((3, 0) if kept else (2, 1))


def test_rounded_pair_starts_where_it_ends():
    pairs = pair_events(one_pixel([1, 1, 1], [0, 150, 161], refractory_us=11.7, crossfade=1.0))
    np.testing.assert_array_equal(pairs.phase_start[1], pairs.phase_end[1])


def test_many_close_pairs_warn():
    """10 of 99 pairs lie within the refractory period; 4 of 99 give no warning."""
    t = np.arange(100) * 50
    for n_close, warns in ((4, False), (10, True)):
        close = t.copy()
        close[3 : 3 + 3 * n_close : 3] = close[2 : 2 + 3 * n_close : 3] + 5
        recording = one_pixel(np.arange(100) % 2, close)
        if warns:
            with pytest.warns(InputWarning, match=r"10% of the event pairs lie within refractory_us.*10 us"):
                pairs = pair_events(recording)
        else:
            pairs = pair_events(recording)
        assert pairs.n_dropped == n_close


def test_phase_stays_below_the_number_of_slots():
    """A time just before the end of a round rounds to n_slot in float32 and becomes 0, the same light."""
    recording = one_pixel([1, 0], [0, 399_999_999], slot_us=1e8, crossfade=1.0)
    exact, _ = phase(recording.events.t[1:], recording.schedule, recording.round_start_us)
    assert exact[0] < 4 and np.float32(exact[0]) == 4
    assert pair_events(recording).phase_end[0] == 0


def test_order_of_simultaneous_events_is_kept():
    recording = one_pixel([1, 0, 1, 0], [5, 70, 70, 200], refractory_us=0.0)
    np.testing.assert_array_equal(pair_events(recording).polarity, [-1, 1, -1])


@pytest.mark.parametrize("masked", [False, True])
def test_no_pair_is_refused(recording, masked):
    if not masked:
        recording = replace(recording, round_start_us=recording.round_start_us + 10**6)
    mask = np.zeros((HEIGHT, WIDTH), bool) if masked else None
    with pytest.raises(InputError, match="No two events of a pixel"):
        pair_events(recording, mask)


def test_silence_is_probed_at_every_slot_start_between_events():
    """By hand: reference memorised at 60, slots of 100 us, an event at 330, the end at 800 (two rounds)."""
    pairs = pair_events(one_pixel([1, 0], [50, 330], rounds=[0, 400, 800]))
    pixel = 2 * WIDTH + 3
    begin, end = pairs.silent_offset[pixel], pairs.silent_offset[pixel + 1]
    assert begin == 0
    assert end == pairs.silent_offset[-1]
    # from 60 to 330: slots 1, 2, 3; from 340 to the end: slot 0 of the second round and on
    np.testing.assert_array_equal(pairs.silent_probe, [1, 2, 3, 0, 1, 2, 3])
    np.testing.assert_array_equal(pairs.probe_offset, [0, 3, 7])
    np.testing.assert_array_equal(pairs.silent_start[begin:end], [0, 3])
    np.testing.assert_array_equal(pairs.silent_end[begin:end], [3, 3])
    np.testing.assert_array_equal(pairs.silent_polarity[begin:end], [-1, 0])


def test_a_silence_of_many_rounds_is_probed_for_one():
    pairs = pair_events(one_pixel([1, 0], [50, 3330], rounds=[400 * r for r in range(11)]))
    gap = pairs.silent_probe[: len(pairs.silent_probe) - 4]
    np.testing.assert_array_equal(gap, [1, 2, 3, 0])


def test_silence_outside_the_rounds_says_nothing():
    pairs = pair_events(one_pixel([1, 1, 0, 1], [50, 350, 380, 900], rounds=[200, 600]))
    np.testing.assert_array_equal(pairs.silent_start, [])


def test_a_leak_adds_to_the_change_since_the_reference_was_memorised():
    """By hand, of 1e-3 a us: from 60 to 330; from there half of the rest, and half a round of a longer one."""
    given = one_pixel([1, 0], [50, 330], rounds=[0, 400, 800])
    pairs, without = pair_events(given, leak=1e-3), pair_events(given)
    assert pairs.bias == pytest.approx([0.27]) and without.bias.tolist() == [0]
    np.testing.assert_allclose(pairs.silent_bias, [0.135, 0.5 * 0.001 * 400], rtol=1e-5)
    assert not without.silent_bias.any()
    long = pair_events(one_pixel([1, 0], [50, 3330], rounds=[400 * r for r in range(11)]), leak=1e-3)
    assert long.bias == pytest.approx([3.27]) and long.silent_bias[0] == pytest.approx(0.2)
