"""Guesses of what pixels see of the LEDs: which are tried, the best of them, and what they cost."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.solve.guesses import (
    ALL_TERMS,
    ARC,
    MISMATCH,
    N_CHANGE,
    PARTIAL,
    Guess,
    Judge,
    arcs,
    changes,
    cheapest,
)


@pytest.mark.parametrize(("n_led", "begins"), [(3, ()), (24, ()), (24, (8,)), (50, ())])
def test_arcs_are_contiguous_in_azimuth(n_led, begins):
    order = np.random.default_rng(0).permutation(n_led)
    seen = arcs(order, *begins)
    assert not begins or len(seen) < len(arcs(order)) / 2
    assert (seen[0] == 1).all() and (seen[1:] == 0).any(axis=1).all() and (seen[1:] == 1).any(axis=1).all()
    ring = seen[1:, order]
    assert (np.abs(ring - np.roll(ring, 1, axis=1)).sum(axis=1) == 2).all()
    assert len(np.unique(seen, axis=0)) == len(seen)


def test_small_changes():
    """An arc grows and shrinks at either end, its ends are dimmed, and single LEDs change sides."""
    share = np.ones((24, 1), np.float32)
    share[4:8] = 0
    made = {tuple(c[:, 0].tolist()) for c in changes(share)}
    grown, shrunk, dimmed, alone, freed = (share.copy() for _ in range(5))
    grown[3], shrunk[7], dimmed[8], alone[15], freed[5] = 0, 1, 0.5, 0, 1
    for wanted in (grown, shrunk, dimmed, alone, freed):
        assert tuple(wanted[:, 0].tolist()) in made
    assert all(0 <= v <= 1 for c in made for v in c)
    assert abs(len(changes(share)) - N_CHANGE) <= 2


def test_the_best_guess_of_each_pixel():
    guess = Guess(np.ones((2, 3), np.float32), np.zeros((3, 1)), np.array([5.0, 5.0, 5.0]))
    pixel, cost = np.array([1, 1, 0, 2]), np.array([4.0, 3.0, 6.0, 5.0])
    new = guess.better(pixel, np.zeros((2, 4), np.float32), np.arange(4.0)[:, None], cost)
    assert new.cost.tolist() == [5, 3, 5] and new.theta[:, 0].tolist() == [0, 1, 0]
    assert new.share.tolist() == [[1, 0, 1], [1, 0, 1]] and (guess.share == 1).all()


def test_the_cheapest_guesses_of_each_pixel():
    pixel, cost = np.array([4, 1, 4, 4, 1]), np.array([3.0, 5.0, 1.0, 2.0, 4.0])
    assert cheapest(pixel, cost, 1).tolist() == [2, 4]
    assert cheapest(pixel, cost, 2).tolist() == [1, 2, 3, 4]
    assert cheapest(pixel[:0], cost[:0], 2).tolist() == []


def test_a_race_fits_well_what_is_cheap_soon(monkeypatch):
    """Guesses are fitted from where they started; a prior counts, too."""
    cost = {0: 1.0, 1: 9.0, 2: 2.0}

    def fit(self, pixel, share, theta, descents, terms):
        assert (terms == ALL_TERMS) == (len(pixel) == 2)
        return theta + 1, np.array([cost[int(t)] for t in theta[:, 0]])

    monkeypatch.setattr(Judge, "_fit", fit)
    judge, share = Judge(None, None, None, np.arange(3)), np.ones((3, 3), np.float32)
    start = np.arange(3.0)[:, None]
    pixel, kept, theta, found = judge.race(np.full(3, 7), share, start, ((None, 4),), 2)
    assert pixel.tolist() == [7, 7] and kept.shape == (3, 2)
    assert theta[:, 0].tolist() == [1, 3] and found.tolist() == [1, 2]
    hidden = share.copy()
    hidden[0, 0] = 0
    assert judge.race(np.full(3, 7), hidden, start, ((None, 4),), 2)[2][:, 0].tolist() == [1, 3]
    cost[1] = 3.0
    assert judge.race(np.full(3, 7), hidden, start, ((None, 4),), 2)[2][:, 0].tolist() == [2, 3]


def test_what_departures_cost():
    """By hand: two arcs with a half seen LED between, of which one does not face the pixel."""
    traced, facing = np.ones((24, 5), np.float32), np.ones((24, 5), bool)
    facing[7] = False
    pixel, share = np.array([3, 3]), np.ones((24, 2), np.float32)
    share[[5, 6, 7], 0] = 0, 0.5, 0
    judge = Judge(None, None, None, np.arange(24), traced, facing)
    np.testing.assert_allclose(judge.prior(pixel, share), [ARC + PARTIAL + 1.5 * MISMATCH, 0])
    blind = replace(judge, traced=None)
    np.testing.assert_allclose(blind.prior(pixel, share), [1.5 * ARC + PARTIAL, 0])
