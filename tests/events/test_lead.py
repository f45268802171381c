"""How early noise fires an event, against noise of two poles that is made by steps."""

import math

import numpy as np
import pytest
from numba import njit
from scipy.linalg import expm

from evsdr.events.lead import LARGEST, MOVING, POLES, SMALLEST, TABLE, kept, lead_of, read_lead

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
@pytest.mark.parametrize("kappa", [0.1, 1.0, 6.0, 30.0, 300.0])
def test_the_lead_is_that_of_two_poles(kappa, poles):
    lead, _ = first_meetings(kappa, poles)
    mean, variance, _ = read_lead(TABLE, kappa, False, math.log((poles - 1) / (POLES - 1)))
    assert mean == pytest.approx(lead.mean(), abs=0.24)
    assert math.sqrt(variance) == pytest.approx(lead.std(), abs=0.07)


@pytest.mark.parametrize("kappa", [0.1, 1.0, 10.0, 100.0])
def test_noise_that_meets_a_level_rises(kappa):
    """The formula is the mean of all meetings, not only of first ones."""
    _, velocity = first_meetings(kappa, POLES)
    _, _, told = read_lead(TABLE, kappa, False, 0.0)
    assert told == pytest.approx(velocity.mean(), abs=0.2)


def test_slow_levels_are_met_early_and_fast_ones_as_noise_stands():
    mean = [read_lead(TABLE, kappa, False, 0.0)[0] for kappa in (1e-9, 0.01, 1.0, 100.0, 1e6, 1e20)]
    assert mean[0] == mean[1] == pytest.approx(0, abs=0.02) and np.all(np.diff(mean[1:]) > 0.2)
    assert mean[-1] == pytest.approx(read_lead(TABLE, 10**MOVING, False, 0.0)[0])
    assert read_lead(TABLE, 1e20, False, 0.0)[2] == pytest.approx(
        np.sqrt(POLES * np.pi / 2), rel=1e-6
    )  # Rayleigh's
    assert read_lead(TABLE, 0.01, False, 0.0)[2] == pytest.approx(
        POLES * 0.01, rel=0.01
    )  # all that move are met


@njit(cache=True)
def _records(rest, jump, step, ends, exact, shock, normals):
    """Sum weights of records of v + noise, their noise and its square, in spans of own time after light jumped."""
    out, n_rest = np.zeros((3, len(ends))), int(rest / step)
    for i in range(len(normals)):
        np.random.seed(i)
        x, v = normals[i, 0], normals[i, 1] * math.sqrt(shock[2, 0])
        most, k, t = -1e9, 0, 0.0
        while k < len(ends):
            a, b = np.random.normal(), np.random.normal()
            x, v = (
                exact[0, 0] * x + exact[0, 1] * v + shock[0, 0] * a,
                exact[1, 0] * x + exact[1, 1] * v + shock[1, 0] * a + shock[1, 1] * b,
            )
            if n_rest > 0:
                n_rest -= 1
                most = max(most, x)
                continue
            t += step
            if t > ends[k]:
                k += 1
                continue
            here = x + jump * (1 - math.exp(-t))
            if here > most:
                rise = here - most if most > -1e9 else 0.0
                most = here
                out[:, k] += rise * np.array([1.0, x, x * x])
        n_rest = int(rest / step)
    return out


def leads_after_a_jump(jump, rest, ends):
    """Give mean and standard deviation of the lead of events between ends of spans, of levels as likely anywhere."""
    drift = np.array([[0.0, 1.0], [-POLES, -(1 + POLES)]])
    exact, still = expm(drift * STEP), np.diag([1.0, POLES])
    shock = np.zeros((3, 2))
    shock[:2] = np.linalg.cholesky(still - exact @ still @ exact.T)
    shock[2, 0] = POLES
    start = np.random.default_rng(2).standard_normal((4 * N_PATH, 2))
    weight, first, second = _records(rest, jump, STEP, np.array(ends), exact, shock, start)
    return first / weight, np.sqrt(second / weight - (first / weight) ** 2)


@pytest.mark.parametrize("jump", [5.0, 20.0])
def test_a_level_that_comes_to_rest_is_met_later_than_a_steady_one_of_its_speed(jump):
    """After a hard switch v slows down: noise has not tried as long as the speed of now would have it."""
    ends = np.array([0.5, 2.5, 3.5, 5.5, 6.5, 9.5, 10.5, 29.5, 30.5])
    mean, scatter = (found[2::2] for found in leads_after_a_jump(jump, 0.0, ends))
    kappa = np.exp([3.0, 6.0, 10.0, 30.0]) / jump
    told = np.array([read_lead(TABLE, k, True, 0.0)[:2] for k in kappa])
    np.testing.assert_allclose(told[:, 0], mean, atol=0.12)
    np.testing.assert_allclose(np.sqrt(told[:, 1]), scatter, atol=0.1)
    assert read_lead(TABLE, kappa[1], False, 0.0)[0] > mean[1] + 0.3


@pytest.mark.parametrize("jump", [3.0, 20.0])
def test_levels_that_were_near_at_rest_have_been_met(jump):
    rest, late, noise = 30.0, jump * math.exp(-30.0), 0.01
    ends = np.array([0.05, 0.15, 0.35, 0.45])
    mean, scatter = (found[1::2] for found in leads_after_a_jump(jump, rest, ends))
    for k, t in enumerate((0.1, 0.4)):
        left = jump * math.exp(-t)
        told = lead_of(TABLE, noise, left * noise, (True, (jump - left) * noise, late * noise), 0.0)
        assert told[0] == pytest.approx(mean[k], abs=0.2)
        assert math.sqrt(told[1]) == pytest.approx(scatter[k], abs=0.15)
    always = lead_of(TABLE, noise, left * noise, (True, np.inf, np.inf), 0.0)
    assert always == read_lead(TABLE, 1 / left, True, 0.0)
    assert told[0] > always[0] + 0.1 or jump > 10  # far beyond what was at rest nothing is left of that


@pytest.mark.parametrize("own_time", [0.0, 0.3, 2.0])
def test_noise_is_kept_as_its_poles_say(own_time):
    drift = np.array([[0.0, 1.0], [-POLES, -(1 + POLES)]])
    np.testing.assert_allclose(kept(own_time, 0.0), expm(drift * own_time)[0], atol=1e-12)


def test_how_fast_a_threshold_comes_nearer_is_told_by_the_lag():
    for late in (0.02, -0.02):
        for rests in (False, True):
            told = lead_of(TABLE, 0.01, late, (rests, np.inf, np.inf), 0.0)
            assert told == read_lead(TABLE, 0.5, rests, 0.0)


def test_the_longer_light_rests_the_later_levels_are_met():
    """In proportion to its own time, not without end: of steady levels only so slow ones are known."""
    lead = [read_lead(TABLE, math.exp(own), True, 0.0)[0] for own in (1.0, 10.0, 30.0, 100.0, 600.0)]
    assert np.all(np.diff(lead) > 0.2) and lead[-1] < 4
    assert read_lead(TABLE, 1e305, True, 0.0)[0] == read_lead(TABLE, 10**LARGEST, True, 0.0)[0]
    assert np.isfinite(TABLE).all() and TABLE.shape[2] > (MOVING - SMALLEST) * 8
