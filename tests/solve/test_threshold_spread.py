"""The distribution of thresholds behind noisy pixels."""

import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.arrays import owned
from evsdr.solve.threshold_spread import FIRST_SIGMA, SMALLEST_SPREAD, first_spread, learn_spread

N, N_UNKNOWN = 3000, 4


def pixels(rng, mean, spread, sigma, pull=FIRST_SIGMA[0]):
    """Posterior means, gradients there and matrices of pixels whose data know log thresholds to sigma, of all or of each."""
    centre, sigma = np.zeros(2), np.broadcast_to(sigma, N)[:, None]
    hidden = rng.normal(mean, spread, (N, 2))
    data = hidden + sigma * rng.normal(size=(N, 2))
    precision = 1 / sigma**2 + 1 / pull**2
    posterior = (data / sigma**2 + centre / pull**2) / precision
    theta = [owned(mi.Float, column) for column in (*np.zeros((2, N)), *posterior.T)]
    matrix = np.zeros((N, N_UNKNOWN, N_UNKNOWN))
    matrix[:, [0, 1], [0, 1]] = 1
    matrix[:, [2, 3], [2, 3]] = precision
    rows, columns = np.tril_indices(N_UNKNOWN)
    return theta, still(theta), [owned(mi.Float, column) for column in matrix[:, rows, columns].T]


def still(theta):
    """Gradient where a descent has ended."""
    return [owned(mi.Float, np.zeros(N))] * len(theta)


@pytest.mark.parametrize("spread", [0.0, 0.05, 0.2])
def test_mean_and_spread_are_found(rng, spread):
    theta, gradient, matrix = pixels(rng, [0.15, -0.1], spread, 0.03)
    found = [float(v[0]) for v in learn_spread(theta, gradient, matrix, first_spread(mi.Float))]
    assert found[:2] == pytest.approx([0.15, -0.1], abs=0.012)
    assert found[2:] == pytest.approx([max(spread, SMALLEST_SPREAD)] * 2, abs=0.012)


def test_pixels_that_know_little_don_t_hide_the_spread(rng):
    """Dark pixels beside bright ones: the median of squares is that of the bright, the median of variances lies between."""
    sigma = np.where(np.arange(N) % 20 < 11, 1.0, 0.03)
    theta, gradient, matrix = pixels(rng, [0.0, 0.0], 0.1, sigma)
    found = [float(v[0]) for v in learn_spread(theta, gradient, matrix, first_spread(mi.Float))]
    assert found[2:] == pytest.approx([0.1] * 2, abs=0.01)


def test_two_camps_have_a_spread(rng):
    """As under a wrong reading of the events: no pixel lies near the middle."""
    camp = np.where(np.arange(N) % 2, 1.3, -1.3)[:, None] * [1, -1]
    theta, gradient, matrix = pixels(rng, camp, 0.01, 0.03)
    found = [float(v[0]) for v in learn_spread(theta, gradient, matrix, first_spread(mi.Float))]
    assert np.isfinite(found).all() and min(found[2:]) > 0.3


def test_outliers_don_t_count(rng):
    theta, gradient, matrix = pixels(rng, [0.0, 0.0], 0.02, 0.02)
    values = theta[2].numpy().copy()
    values[::25] = 3.0
    theta[2] = owned(mi.Float, values)
    found = [float(v[0]) for v in learn_spread(theta, gradient, matrix, first_spread(mi.Float))]
    assert found[:2] == pytest.approx([0.0, 0.0], abs=0.01)
    assert found[2] < 0.04


def test_a_mean_that_is_held_moves_by_what_the_gradient_asks(rng):
    """Pixels that stayed at a wrong centre, as their distribution is narrow and a descent ended early."""
    theta, _, matrix = pixels(rng, [0.1, -0.1], 0.0, 0.05, pull=0.005)
    posterior = np.stack([t.numpy() for t in theta[2:]], axis=1)
    precision = matrix[-1].numpy()[0]
    gradient = [*still(theta)[:2], *(owned(mi.Float, -precision * column) for column in posterior.T)]
    stayed = [owned(mi.Float, np.zeros(N))] * N_UNKNOWN
    held = first_spread(mi.Float, (0.0, 0.0, 0.005, 0.005))
    found = [float(v[0]) for v in learn_spread(stayed, gradient, matrix, held)]
    assert found[:2] == pytest.approx([0.1, -0.1], abs=0.005)


def test_what_is_common_to_both_thresholds_is_found_at_once(rng):
    """A pixel's data know the ratio of both far better than their product, the contrast."""
    know = np.array([[1.0, -1.0], [-1.0, 1.0]]) * 5e4 + 100.0  # precision of the ratio, and of both
    pull, mean = 0.005, np.array([0.05, 0.05])
    data = mean + rng.multivariate_normal(np.zeros(2), np.linalg.inv(know), N)
    whole = know + np.eye(2) / pull**2
    posterior = data @ know @ np.linalg.inv(whole)
    theta = [owned(mi.Float, column) for column in (*np.zeros((2, N)), *posterior.T)]
    matrix = np.zeros((N, N_UNKNOWN, N_UNKNOWN))
    matrix[:, [0, 1], [0, 1]] = 1
    matrix[:, 2:, 2:] = whole
    rows, columns = np.tril_indices(N_UNKNOWN)
    matrix = [owned(mi.Float, column) for column in matrix[:, rows, columns].T]
    held = first_spread(mi.Float, (0.0, 0.0, pull, pull))
    found = [float(v[0]) for v in learn_spread(theta, still(theta), matrix, held)]
    assert found[:2] == pytest.approx(mean, abs=0.01)


def test_what_curved_pixels_say_does_not_move_the_mean(rng):
    """Pixels whose data are off by a share of their curvature."""
    curved = rng.uniform(0, 0.005, N)
    hidden = np.array([0.04, -0.02]) - 15 * curved[:, None]
    theta, gradient, matrix = pixels(rng, hidden, 0.0, 0.03)
    given = theta, gradient, matrix, first_spread(mi.Float)
    found = [float(v[0]) for v in learn_spread(*given, curved)]
    assert found[:2] == pytest.approx([0.04, -0.02], abs=0.005)
    assert float(learn_spread(*given)[0][0]) < 0.02


def test_what_was_found_before_is_kept():
    told = (0.1, -0.2, 0.3, 0.4)
    assert [float(v[0]) for v in first_spread(mi.Float, told)] == pytest.approx(told)
