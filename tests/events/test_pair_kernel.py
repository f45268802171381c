"""Loops over events against NumPy's own sort and plain Python."""

import numpy as np
import pytest

from evsdr.events.pair_kernel import list_silences, pair, sort_by_pixel

WIDTH, HEIGHT, N_EVENT, N_SLOT, SLOT_US = 5, 4, 400, 6, 100.0


@pytest.fixture
def events(rng):
    """Unsorted places, sorted times, some of them equal."""
    x, y = rng.integers(0, WIDTH, N_EVENT, np.uint16), rng.integers(0, HEIGHT, N_EVENT, np.uint16)
    return x, y, rng.integers(0, 2, N_EVENT, np.int8), np.sort(rng.integers(0, 9000, N_EVENT))


def test_sorted_by_pixel_and_in_time_order(events, rng):
    x, y, p, t = events
    mask = rng.random((HEIGHT, WIDTH)) < 0.7
    offset, p_sorted, t_sorted = sort_by_pixel(x, y, p, t, mask)
    pixel = y.astype(int) * WIDTH + x
    order = np.argsort(pixel, kind="stable")
    order = order[mask.ravel()[pixel[order]]]
    np.testing.assert_array_equal(p_sorted, p[order])
    np.testing.assert_array_equal(t_sorted, t[order])
    count = np.bincount(pixel[order], minlength=WIDTH * HEIGHT)
    np.testing.assert_array_equal(offset, np.append(0, np.cumsum(count)))


def test_pairs_by_hand():
    """Two pixels of three events; one event too close, one memorised and one fired outside the rounds."""
    offset, p, t = (
        np.array([0, 3, 6]),
        np.array([1, 0, 1, 1, 1, 0], np.int8),
        np.array([0, 50, 55, 7, 60, 90]),
    )
    fired, memorised = np.arange(6, dtype=np.float32), 10 + np.arange(6, dtype=np.float32)
    fired_inside = np.array([True, True, True, True, True, False])
    memorised_inside = np.array([True, True, True, False, True, True])
    given = offset, p, t, fired, fired_inside, memorised, memorised_inside
    ahead, left = np.arange(6, dtype=np.float32) / 4, np.arange(6, dtype=np.float32) / 8 + 3
    answer = np.stack([20 + fired, 30 + fired])
    pair_offset, start, end, polarity, bias, answers, n_dropped, n_close = pair(
        *given, 20.0, ahead, left, answer
    )
    np.testing.assert_array_equal(pair_offset, [0, 1, 1])
    assert (start.tolist(), end.tolist(), polarity.tolist()) == ([10.0], [1.0], [-1])
    assert bias.tolist() == [0.25 - 3.0]  # what is there when it fires, without what was memorised
    assert answers.tolist() == [[30.0, 21.0]]  # once it was memorised, and when the next one fires
    assert (n_dropped, n_close) == (3, 1)


def test_a_pair_that_rounding_makes_empty_has_no_bias():
    """It starts where it ends: noise would count twice."""
    one, inside = np.ones(2, np.float32), np.ones(2, bool)
    given = np.array([0, 2]), np.ones(2, np.int8), np.array([0, 20]), one, inside, one, inside, 20.5
    found = pair(*given, one, 3 * one, np.stack([one, 2 * one]))
    assert len(found[4]) == 1 and found[4][0] == 0 and found[5].tolist() == [[1, 1]]
    assert pair(*given, one, 3 * one, np.zeros((2, 0), np.float32))[5].shape == (0, 2)


@pytest.mark.parametrize("refractory_us", [0.0, 33.0])
def test_silences_are_the_slot_starts_that_pass(refractory_us):
    """Steady clock, four rounds: between memorising and firing each start of a slot is probed, for a round at most."""
    rng = np.random.default_rng(1)
    t = [np.unique(rng.integers(0, 2300, n)) for n in (6, 0, 1, 3)]
    offset, times = np.append(0, np.cumsum([len(part) for part in t])), np.concatenate(t)
    last_us = 4 * N_SLOT * SLOT_US - 1e-3

    def phase(at):
        return (at / SLOT_US % N_SLOT).astype(np.float32)

    inside = times + refractory_us < last_us
    shown, kept, left = rng.random((3, len(times))).astype(np.float32)
    p = rng.integers(0, 2, len(times)).astype(np.int8)
    end = last_us, float(phase(np.array(last_us))), True
    found = list_silences(
        offset, p, times, phase(times), np.ones(len(times), bool), phase(times + refractory_us), inside,
        (shown, kept, left), refractory_us, SLOT_US, N_SLOT, end,
    )  # fmt: skip
    silences, count = [0], []
    for pixel in range(4):
        for k in range(offset[pixel], offset[pixel + 1]):
            followed = k + 1 < offset[pixel + 1]
            until = times[k + 1] if followed else last_us
            first = int((times[k] + refractory_us) // SLOT_US) + 1
            starts = [s % N_SLOT for s in range(first, first + N_SLOT) if s * SLOT_US <= until]
            if starts:
                last = (shown[k + 1], 2.0 * p[k + 1] - 1) if followed else (end[1], 0.0)
                count.append(((kept[k], *last, -left[k]), starts))
        silences.append(len(count))
    silent_offset, start, until, polarity, bias, probe_offset, probe = found
    np.testing.assert_array_equal(silent_offset, silences)
    np.testing.assert_array_equal(
        np.stack([start, until, polarity, bias], axis=1), np.array([told for told, _ in count], np.float32)
    )
    np.testing.assert_array_equal(probe_offset, np.append(0, np.cumsum([len(starts) for _, starts in count])))
    np.testing.assert_array_equal(probe, np.concatenate([starts for _, starts in count]))
    assert len(count) > 8 and (polarity == 0).sum() == 3
