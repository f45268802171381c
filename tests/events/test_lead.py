"""How early noise fires an event, against noise of two poles that is made by steps."""

import math

import numpy as np
import pytest
from numba import njit
from scipy.linalg import expm

from evsdr.events.lead import POLES, TABLE, TRIES, kept, lead_of, read_lead
from evsdr.events.receptor import N_COLUMN

N_PATH, STEP = 1000, 0.02  # paths, and time constants per step
HIGHEST = 5.0  # standard deviations from which a level sinks


@njit(cache=True)
def _meet(sink, step, exact, shock, normals):
    """Give level and velocity where noise first meets a level that sinks by `sink` per time constant."""
    n = normals.shape[0]
    out = np.empty((n, 2))
    for i in range(n):
        x, v, level = normals[i, 0], normals[i, 1] * math.sqrt(shock[3, 0]), HIGHEST
        np.random.seed(i)
        while x < level:
            a, b = np.random.normal(), np.random.normal()
            new = exact[0, 0] * x + exact[0, 1] * v + shock[0, 0] * a
            v = exact[1, 0] * x + exact[1, 1] * v + shock[1, 0] * a + shock[1, 1] * b
            x = new
            level -= sink * step
        out[i] = level + 0.5 * sink * step, v
    return out


def first_meetings(kappa, poles):
    """Noise x of variance 1 whose second pole is `poles` times as fast as the first, in exact steps."""
    drift = np.array([[0.0, 1.0], [-poles, -(1 + poles)]])
    step = min(STEP, 0.1 * kappa)  # the level sinks little in one
    exact, still = expm(drift * step), np.diag([1.0, poles])
    shock = np.zeros((4, 2))
    shock[:2] = np.linalg.cholesky(still - exact @ still @ exact.T)
    shock[3, 0] = poles
    start = np.random.default_rng(1).standard_normal((N_PATH, 2))
    return _meet(1 / kappa, step, exact, shock, start).T


@pytest.mark.parametrize("poles", [2.0, POLES])
@pytest.mark.parametrize("kappa", [0.1, 6.0, 300.0])
def test_the_lead_is_that_of_two_poles(kappa, poles):
    lead, _ = first_meetings(kappa, poles)
    mean, variance, _ = read_lead(TABLE, kappa, math.log((poles - 1) / (POLES - 1)))
    assert mean == pytest.approx(lead.mean(), abs=0.24)
    assert math.sqrt(variance) == pytest.approx(lead.std(), abs=0.07)


@pytest.mark.parametrize("kappa", [0.1, 10.0])
def test_noise_that_meets_a_level_rises(kappa):
    """The formula is the mean of all meetings, not only of first ones."""
    _, velocity = first_meetings(kappa, POLES)
    _, _, told = read_lead(TABLE, kappa, 0.0)
    assert told == pytest.approx(velocity.mean(), abs=0.2)


def test_slow_levels_are_met_early_and_fast_ones_as_noise_stands():
    mean = [read_lead(TABLE, kappa, 0.0)[0] for kappa in (1e-9, 0.01, 1.0, 100.0, 1e6, 1e20)]
    assert mean[0] == mean[1] == pytest.approx(0, abs=0.02) and np.all(np.diff(mean[1:]) > 0.2)
    assert read_lead(TABLE, 1e20, 0.0)[0] == pytest.approx(TABLE[0, -1])
    assert read_lead(TABLE, 1e20, 0.0)[2] == pytest.approx(np.sqrt(POLES * np.pi / 2), rel=1e-6)  # Rayleigh's
    assert read_lead(TABLE, 0.01, 0.0)[2] == pytest.approx(POLES * 0.01, rel=0.01)  # all that move are met


@pytest.mark.parametrize("own_time", [0.0, 0.3, 2.0])
def test_noise_is_kept_as_its_poles_say(own_time):
    drift = np.array([[0.0, 1.0], [-POLES, -(1 + POLES)]])
    np.testing.assert_allclose(kept(own_time, 0.0), expm(drift * own_time)[0], atol=1e-12)


def test_how_fast_a_threshold_comes_nearer_is_told_by_the_lag():
    nodes, noise = np.zeros((3, N_COLUMN)), 0.01
    assert lead_of(TABLE, noise, 0.02, 10.0, 1.5, nodes, 1.0, 0.0) == read_lead(TABLE, 0.5, 0.0)
    assert lead_of(TABLE, noise, -0.02, 10.0, 1.5, nodes, 1.0, 0.0) == read_lead(TABLE, 0.5, 0.0)


def test_light_that_rests_lets_noise_try_since_it_came_to_rest():
    """Without that a level that has come to rest long ago would be met by infinitely many tries."""
    nodes, noise, own = np.zeros((3, N_COLUMN)), 0.01, 10.0
    nodes[1, 0] = -0.05
    told = lead_of(TABLE, noise, 0.0, own, 1.25, nodes, 0.5, 0.0)
    assert told == pytest.approx(read_lead(TABLE, 0.2 + TRIES * own * 0.25, 0.0))
    fading = lead_of(TABLE, noise, 0.0, own, 1.75, nodes, 0.5, 0.0)
    assert fading[0] > told[0] + 1
