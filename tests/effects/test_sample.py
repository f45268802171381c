import numpy as np
import pytest

from evsdr.effects.sample import MOST_GAIN, Sample, gained
from evsdr.model.lambert import LambertianRing
from tests.support.glossy import mean_error, sphere


def test_no_pixel_counts_for_more_than_the_most():
    before, after = np.array([100.0, 2, 2, 1]), np.array([0.0, 1, 1, 2])
    gain = np.array([MOST_GAIN, 1, 1, -1])
    assert gained(before, after) == pytest.approx((gain.sum() / np.linalg.norm(gain), gain.mean()))


def test_held_back_pairs_do_not_tell():
    """They are explained less well than the others."""
    problem, normal, *_ = sphere(size=16)
    pixel = np.flatnonzero(normal[:, 2] > 0.5)
    sample = Sample.of(problem, pixel, 0.1)
    model, start = LambertianRing(sample.illumination), np.zeros((len(pixel), 10))
    start[:, :2] = -normal[pixel, :2] / normal[pixel, 2:]
    start[:, 2:] = -1.0
    cost, theta = sample.solve(start, model)
    most, held, other = sample.hold_back(start, model)
    assert np.median(most + held) >= np.median(cost) - 0.01
    assert max(mean_error(t, normal[pixel]) for t in (theta, other)) < 2
    assert np.median(held) > np.median(cost) / 4
    assert 0.05 < sample.scatter(theta, model) < 0.15 < sample.scatter(start, model)
