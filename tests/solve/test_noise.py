"""How residuals scatter."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

from evsdr.model.lambert import LambertianRing
from evsdr.solve import loop
from evsdr.solve.noise import (
    FEW_SLOTS,
    IGNORED,
    UNTOLD,
    Scatter,
    Slotted,
    noise_factors,
    slot_factors,
    slotted,
)
from evsdr.solve.unknowns import first_theta
from tests.support.sphere import sphere_problem


def test_noise_of_most_pixels_does_not_see_hot_ones(rng):
    value = 0.1 * rng.uniform(0.8, 1.2, 101)
    value[:40] = 5.0
    assert Scatter(np.arange(101), np.full(101, 50), value).of_most() == pytest.approx(0.12, abs=0.02)
    hot = np.where(np.arange(101) < 40, 5000, 50)
    assert Scatter(np.arange(101), hot, value).of_most() == pytest.approx(0.12, abs=0.02)
    assert Scatter(np.arange(0), np.arange(0), np.empty(0)).of_most() == 1.0


def test_pixels_that_have_no_more_events_than_unknowns_do_not_tell_noise():
    """Theirs explain all; one more tells little, and where there are none a guess stands."""
    value, count = np.array([1e-4] * 60 + [0.2] * 20), np.array([12] * 60 + [30] * 20)
    scatter = Scatter(np.arange(80), count, value, 12)
    assert scatter.of_most() == pytest.approx(0.2)
    assert replace(scatter, count=np.append(count[:60] + 1, count[60:])).of_most() == pytest.approx(0.2)
    assert replace(scatter, n_unknown=30).of_most() == pytest.approx(UNTOLD)
    assert replace(scatter, n_unknown=0).of_most() == pytest.approx(0.005)


def test_pixels_that_contradict_the_model_are_ignored():
    """Few pairs tell little: their factor is shrunk toward 1; pixels without pairs have 1."""
    scatter = Scatter(np.array([0, 2, 3, 4]), np.array([100, 100, 4, 100]), np.array([0.1, 0.2, 0.2, 0.9]))
    factor = noise_factors(scatter, 0.1, 6, 10)
    assert factor[[0, 1, 5]] == pytest.approx(1)
    assert factor[2] == pytest.approx(1.5)
    assert 1 < factor[3] < 1.2
    assert factor[4] == IGNORED
    few = Scatter(np.array([0]), np.array([8]), np.array([0.9]))
    assert noise_factors(few, 0.1, 1, 10)[0] < IGNORED


def slots(rng, off):
    """Six events in each of 20 slots of some pixels, whose residuals are off by `off` (n_pixel, 20)."""
    n_pixel, n_slot = off.shape
    pixel, slot, _ = (a.ravel() for a in np.mgrid[:n_pixel, :n_slot, :6])
    score = 0.1 * rng.normal(size=len(pixel)) + off[pixel, slot]
    return Slotted(pixel, slot, score, *np.zeros((3, len(pixel))), (n_pixel + 1, n_slot))


def test_what_comes_again_in_a_slot_is_more_than_noise(rng):
    """Where slots are off by s, n events of each are worth those of a noise of sqrt(1 + n s^2)."""
    off = np.zeros((60, 20))
    off[:20] = 0.1 * rng.normal(size=(20, 20))
    pairs = slots(rng, off)
    factor = slot_factors(pairs)
    inflated = np.sqrt((FEW_SLOTS + 20 * (1 + 6)) / (FEW_SLOTS + 20))
    assert np.mean(factor[:20]) == pytest.approx(inflated, rel=0.15)
    assert np.mean(factor[20:60]) < 1.15 and factor[60] == 1
    shared = pairs.shared
    assert np.mean(shared[pairs.pixel < 20]) == pytest.approx(0.01, rel=0.25)
    assert abs(np.mean(shared[pairs.pixel >= 20])) < 5e-4
    assert slot_factors(Slotted(*np.zeros((2, 0), int), *np.zeros((4, 0)), (3, 4))).tolist() == [1, 1, 1]


def test_an_event_that_is_alone_in_its_slot_shares_nothing():
    pairs = Slotted(
        np.zeros(3, int), np.array([0, 0, 1]), np.array([1.0, 2.0, 5.0]), *np.zeros((3, 3)), (2, 2)
    )
    np.testing.assert_allclose(pairs.shared, [2, 2, np.nan])
    assert pairs.n_group.tolist() == [2, 0]


def test_slots_of_other_pixels_take_no_room(rng):
    """Pixels of readings that are tried side by side have their slots behind each other's."""
    off = 0.1 * rng.normal(size=(30, 20))
    pairs = slots(rng, off)
    n_pixel, n_slot = pairs.shape
    apart = replace(pairs, group=pairs.group + n_slot * pairs.pixel, shape=(n_pixel, n_slot * n_pixel))
    assert apart.number.shape == pairs.number.shape
    np.testing.assert_array_equal(apart.shared, pairs.shared)
    np.testing.assert_array_equal(slot_factors(apart), slot_factors(pairs))


def test_pairs_are_looked_at_with_their_slots_and_light():
    problem, truth = sphere_problem(12, event_noise=0.1)
    data = loop.data_of(
        LambertianRing(problem.illumination),
        problem.pairs,
        problem.illumination.constant_light,
        problem.grid,
        2.0,
    )
    theta = first_theta(truth[:, :3], problem.illumination.n_band, False, type(data.constant_light))
    pairs = slotted(data, loop.start_of(data, theta))
    assert np.bincount(pairs.pixel, minlength=problem.n_pixel).max() <= 128
    assert (pairs.light > float(data.constant_light[0])).all()
    assert (pairs.end >= 0).all() and pairs.end.max() < dr.width(problem.pairs.slot_leds)
