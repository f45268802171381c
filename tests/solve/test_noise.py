"""How residuals scatter."""

import numpy as np
import pytest

from evsdr.solve.noise import IGNORED, Scatter, noise_factors


def test_noise_of_most_pixels_does_not_see_hot_ones(rng):
    value = 0.1 * rng.uniform(0.8, 1.2, 101)
    value[:40] = 5.0
    assert Scatter(np.arange(101), np.full(101, 50), value).of_most() == pytest.approx(0.12, abs=0.02)
    assert Scatter(np.arange(0), np.arange(0), np.empty(0)).of_most() == 1.0


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
