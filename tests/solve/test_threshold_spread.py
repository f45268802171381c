"""The distribution of thresholds behind noisy pixels."""

import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.arrays import owned
from evsdr.solve.threshold_spread import SMALLEST_SPREAD, first_spread, learn_spread

N, N_UNKNOWN = 3000, 4


def pixels(rng, mean, spread, sigma):
    """Posterior means and matrices of pixels whose data know log thresholds to sigma, pulled by the first spread."""
    centre, pull = np.zeros(2), 0.3
    hidden = rng.normal(mean, spread, (N, 2))
    data = hidden + sigma * rng.normal(size=(N, 2))
    precision = 1 / sigma**2 + 1 / pull**2
    posterior = (data / sigma**2 + centre / pull**2) / precision
    theta = [owned(mi.Float, column) for column in (*np.zeros((2, N)), *posterior.T)]
    matrix = np.zeros((N, N_UNKNOWN, N_UNKNOWN))
    matrix[:, [0, 1], [0, 1]] = 1
    matrix[:, [2, 3], [2, 3]] = precision
    rows, columns = np.tril_indices(N_UNKNOWN)
    return theta, [owned(mi.Float, column) for column in matrix[:, rows, columns].T]


@pytest.mark.parametrize("spread", [0.0, 0.05, 0.2])
def test_mean_and_spread_are_found(rng, spread):
    theta, matrix = pixels(rng, [0.15, -0.1], spread, 0.03)
    found = [float(v[0]) for v in learn_spread(theta, matrix, first_spread(mi.Float))]
    assert found[:2] == pytest.approx([0.15, -0.1], abs=0.012)
    assert found[2:] == pytest.approx([max(spread, SMALLEST_SPREAD)] * 2, abs=0.012)


def test_outliers_don_t_count(rng):
    theta, matrix = pixels(rng, [0.0, 0.0], 0.02, 0.02)
    values = theta[2].numpy().copy()
    values[::25] = 3.0
    theta[2] = owned(mi.Float, values)
    found = [float(v[0]) for v in learn_spread(theta, matrix, first_spread(mi.Float))]
    assert found[:2] == pytest.approx([0.0, 0.0], abs=0.01)
    assert found[2] < 0.04


def test_what_was_found_before_is_kept():
    told = (0.1, -0.2, 0.3, 0.4)
    assert [float(v[0]) for v in first_spread(mi.Float, told)] == pytest.approx(told)
