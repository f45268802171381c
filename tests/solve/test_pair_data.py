"""Pairs as arrays: packed and looked up, left out and thinned."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evsdr.solve.pair_data import (
    PairData,
    Table,
    bounds,
    ends,
    pack_phases,
    pack_slots,
    signal_table,
    thin,
    unlit_by,
    unpack_pair,
    without,
)

COUNT, SILENT = np.array([0, 3, 100, 7, 12]), np.array([50, 0, 12, 1, 13])


def numbered(count):
    """First and last, and a list whose entries tell their own number."""
    k = np.arange(count.sum())
    phases = mi.Float(np.stack([k, -k], axis=-1).ravel().astype(np.float32))
    return *bounds(np.append(0, np.cumsum(count)), mi.UInt32), phases


@pytest.fixture
def pairs():
    weight = mi.Float(np.arange(COUNT.sum(), dtype=np.float32))
    silent_first, silent_last, silent_phases = numbered(SILENT)
    probes = mi.UInt32(np.repeat(np.arange(SILENT.sum(), dtype=np.uint32), 2))
    return PairData(
        *numbered(COUNT),
        threshold_on=None,
        threshold_off=None,
        slot_leds=None,
        silent_first=silent_first,
        silent_last=silent_last,
        silent_phases=silent_phases,
        silent_probes=probes,
        silent_bias=mi.Float(np.arange(SILENT.sum(), dtype=np.float32)),
        probes=mi.Float(0),
        bias=0.5 * weight,
        weight=weight,
    )


def entries(pairs, silent=""):
    """Numbers of the entries that are left of each pixel."""
    first, last, phases = (getattr(pairs, f"{silent}{name}").numpy() for name in ("first", "last", "phases"))
    one, other = phases.reshape(-1, 2).T
    np.testing.assert_array_equal(one, -other)
    return [one[a:b].astype(int) for a, b in zip(first.astype(int), last.astype(int))]


def test_thinned_lists_are_spread_evenly(pairs):
    """Of 100 pairs every eighth or ninth is left, from the first on; short lists stay whole."""
    few = thin(pairs, 12)
    for kept, count, first in (
        (entries(few), COUNT, np.cumsum(COUNT) - COUNT),
        (entries(few, "silent_"), SILENT, np.cumsum(SILENT) - SILENT),
    ):
        for k, n, start in zip(kept, count, first):
            assert len(k) == min(n, 12)
            assert not len(k) or k[0] == start
            gap = np.diff(np.append(k, start + n))
            assert not len(k) or (gap.min() >= n // len(k) and gap.max() <= -(-n // len(k)))
    kept = np.concatenate(entries(few))
    np.testing.assert_array_equal(few.weight.numpy(), kept)
    np.testing.assert_array_equal(few.bias.numpy(), kept / 2)
    kept = np.concatenate(entries(few, "silent_"))
    np.testing.assert_array_equal(few.silent_probes.numpy(), np.repeat(kept, 2))
    np.testing.assert_array_equal(few.silent_bias.numpy(), kept)


def test_ignored_pixels_say_nothing(pairs):
    ignored = np.array([0, 1, 0, 1, 0], bool)
    left = without(pairs, ignored)
    for kept, count in ((entries(left), COUNT), (entries(left, "silent_"), SILENT)):
        expected = np.arange(count.sum())[np.repeat(~ignored, count)]
        np.testing.assert_array_equal(np.concatenate(kept), expected)
        np.testing.assert_array_equal([len(k) for k in kept], np.where(ignored, 0, count))
    np.testing.assert_array_equal(left.counts, np.where(ignored, 0, COUNT))


@pytest.mark.parametrize("extra", ["bias", "weight"])
def test_chosen_pixels_keep_what_their_pairs_have(pairs, extra):
    """Also where one of the lists is left out."""
    some = replace(
        pairs,
        threshold_on=mi.Float(np.arange(5, dtype=np.float32)),
        threshold_off=mi.Float(np.ones(5, np.float32)),
        **{({"bias", "weight"} - {extra}).pop(): None},
    ).at(mi.UInt32(3, 1))
    kept = [np.arange(103, 110), np.arange(3)]
    np.testing.assert_equal(entries(some), kept)
    np.testing.assert_equal(entries(some, "silent_"), [[62], np.arange(0)])
    assert list(some.having(("bias", "weight"))) == [extra] and some.threshold_on.numpy().tolist() == [3, 1]
    few = thin(some.events, 100)
    np.testing.assert_equal(entries(few), kept)
    kept = np.concatenate(kept)
    np.testing.assert_array_equal(getattr(few, extra).numpy(), kept * (0.5 if extra == "bias" else 1.0))
    assert few.silent_first is None and few.silent_bias is None


phases = st.floats(0, 255, width=32, exclude_max=True)


@given(st.lists(st.tuples(phases, phases, st.sampled_from((-1, 1))), min_size=1, max_size=20))
def test_packing_keeps_phases_and_polarity(told):
    start, end, polarity = np.array(told).T
    packed = mi.Float(pack_phases(start, end, polarity))
    found = unpack_pair(packed, dr.arange(mi.UInt32, len(told)), mi.Bool(True))
    np.testing.assert_array_equal(found[0].numpy(), start.astype(np.float32))
    np.testing.assert_allclose(found[1].numpy(), end, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(found[2].numpy(), polarity)


def test_slots_by_hand():
    """LED of each slot and the next; -1 is LED 4, darkness; the first slot stands again at the end."""
    leds = pack_slots(np.array([2, -1, 0, 3]), 4)
    assert [(v & 0xFFFF, v >> 16) for v in leds.tolist()] == [(2, 4), (4, 0), (0, 3), (3, 2), (2, 4)]


def test_light_at_both_ends_of_a_pair(rng):
    """Two pixels, three LEDs and darkness, against the words of the schedule."""
    signal, order = rng.random((3, 2)).astype(np.float32), np.array([1, -1, 0, 2])
    start, end, polarity = np.array([0.25, 3.5, 2.0]), np.array([1.5, 0.75, 3.999]), np.array([1, -1, 1])
    phases, slots = mi.Float(pack_phases(start, end, polarity)), mi.UInt32(pack_slots(order, 3))
    pairs = PairData(mi.UInt32(0, 1), mi.UInt32(1, 3), phases, None, None, slots)
    pixel = np.array([0, 1, 1])
    given_pixel = mi.UInt32(pixel.astype(np.uint32)), mi.Bool(True)
    table = signal_table([mi.Float(row) for row in signal], 2)
    found = ends(table, pairs, dr.arange(mi.UInt32, 3), *given_pixel)
    lit = np.vstack([signal, np.zeros(2)])[np.append(order, order[0])]
    for value, phase in zip(found, (start, end)):
        slot, fade = phase.astype(int), phase % 1
        expected = (1 - fade) * lit[slot, pixel] + fade * lit[slot + 1, pixel]
        np.testing.assert_allclose(value.numpy(), expected, atol=1e-6)
    np.testing.assert_array_equal(found[2].numpy(), polarity)


def test_events_lit_by_doubtful_leds_are_left_out():
    """Against a look at each event and silence by itself."""
    rng = np.random.default_rng(0)
    n_led, order, count, silent = (
        6,
        np.array([0, 1, -1, 2, 3, 4, 5, -1]),
        np.array([5, 0, 40, 30]),
        [9, 50, 0, 20],
    )
    doubt = rng.random((n_led, 4)) < 0.3
    doubt[:, 3] = False

    def phases(n):
        whole = np.where(rng.random((n, 2)) < 0.3, 0, rng.random((n, 2)))
        return (rng.integers(0, len(order), (n, 2)) + whole).astype(np.float32)

    spans, silences = phases(count.sum()), phases(sum(silent))
    polarity, ended = rng.choice([-1, 1], count.sum()), rng.random(sum(silent)) < 0.7
    probes, probe_count = phases(40).ravel(), rng.integers(0, 3, sum(silent))
    probe_end = np.cumsum(probe_count)
    coded = np.where(ended, 1 + silences[:, 1], 0)
    before = PairData(
        *bounds(np.append(0, np.cumsum(count)), mi.UInt32),
        phases=mi.Float(pack_phases(*spans.T, polarity)),
        threshold_on=None,
        threshold_off=None,
        slot_leds=mi.UInt32(pack_slots(order, n_led)),
        silent_first=bounds(np.append(0, np.cumsum(silent)), mi.UInt32)[0],
        silent_last=bounds(np.append(0, np.cumsum(silent)), mi.UInt32)[1],
        silent_phases=mi.Float(np.stack([silences[:, 0], coded], axis=-1).astype(np.float32).ravel()),
        silent_probes=mi.UInt32(
            np.stack([probe_end - probe_count, probe_end], axis=-1).astype(np.uint32).ravel()
        ),
        silent_bias=mi.Float(np.arange(sum(silent), dtype=np.float32)),
        probes=mi.Float(probes),
        bias=mi.Float(np.arange(count.sum(), dtype=np.float32)),
    )
    after = unlit_by(before, doubt)

    def dim(phase, pixel):
        slot = int(phase)
        leds = [order[slot]] + [order[(slot + 1) % len(order)]] * int(phase > slot)
        return any(led >= 0 and doubt[led, pixel] for led in leds)

    def left(first, last, values):
        return [values.numpy()[a:b].astype(int).tolist() for a, b in zip(first.numpy(), last.numpy())]

    expected = [[], [], [], []]
    for k, pixel in enumerate(np.repeat(np.arange(4), count)):
        if not (dim(spans[k, 0], pixel) or dim(spans[k, 1], pixel)):
            expected[pixel].append(k)
    assert left(after.first, after.last, after.bias) == expected
    assert 0 < sum(map(len, expected)) < count.sum() and len(expected[3]) == count[3]
    expected = [[], [], [], []]
    for k, pixel in enumerate(np.repeat(np.arange(4), silent)):
        passed = [silences[k, 0], *probes[probe_end[k] - probe_count[k] : probe_end[k]]]
        passed += [silences[k, 1]] * int(ended[k])
        if not any(dim(phase, pixel) for phase in passed):
            expected[pixel].append(k)
    assert left(after.silent_first, after.silent_last, after.silent_bias) == expected
    assert unlit_by(before, np.zeros_like(doubt)) is before


@pytest.mark.parametrize("silences", [True, False])
def test_lists_that_hold_nothing_stay_so(silences):
    """As those of silences where times are told in another unit; an array of Dr.Jit then holds one number."""
    none, one = mi.UInt32([0, 0]), mi.Float([0])
    silent = {
        "silent_first": none,
        "silent_last": none,
        "silent_phases": one,
        "silent_probes": mi.UInt32([0]),
    }
    silent |= {"silent_bias": one, "probes": one}
    before = PairData(
        none,
        none,
        phases=one,
        threshold_on=None,
        threshold_off=None,
        slot_leds=mi.UInt32(pack_slots(np.arange(3), 3)),
        bias=one,
        **(silent if silences else {}),
    )
    after = unlit_by(before, np.ones((3, 2), bool))
    assert after.last.numpy().tolist() == [0, 0] and after.phases is one
    assert not silences or after.silent_last.numpy().tolist() == [0, 0]


@pytest.mark.parametrize("n_led", [5, 32, 70])
def test_a_table_of_many_leds_is_filled_in_parts(n_led, rng):
    """What each LED gives stands where it is looked up, darkness last, however many kernels filled the table."""
    values = rng.normal(size=(n_led, 2, 3)).astype(np.float32)
    rows = [[mi.Float(v) for v in of_led] for of_led in values]
    table = Table.of(rows, 3)
    for pixel in range(3):
        for led in range(n_led + 1):
            found = table.at(mi.UInt32(pixel), mi.UInt32(led), True)
            expected = values[led, :, pixel] if led < n_led else (0, 0)
            np.testing.assert_array_equal([found.x[0], found.y[0]], expected)
