"""Numbers that are learnt from the pixels: noise, and the distribution of thresholds."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.solve.unknowns import normal_sigma_deg
from tests.support.sphere import errors, solve, sphere_problem


def test_noise_is_measured_and_sigma_is_honest():
    """Angles relative to their sigma have a mean square of about 1: sigma is their root mean square."""
    problem, truth = sphere_problem(40, event_noise=0.1)
    solution = solve(problem)
    assert solution.noise == pytest.approx(0.1, rel=0.1)
    angle, difference = errors(solution, truth)
    sigma = normal_sigma_deg(*solution.theta[:, :2].T.astype(float), solution.covariance[:, :2, :2])
    inner = truth[:, 2] > 0.4
    assert np.sqrt(np.mean((angle / sigma)[inner] ** 2)) == pytest.approx(1.0, abs=0.15)
    spread = np.sqrt(np.diagonal(solution.covariance, axis1=1, axis2=2)[:, 2:]) * np.exp(
        solution.theta[:, 2:]
    )
    assert np.sqrt(np.mean((difference / spread)[inner] ** 2)) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("told", [0.5, 0.85, 1.15, 2.0])
def test_thresholds_told_wrong_are_found(told):
    """With what the events say, the maps are as good as with true thresholds."""
    problem, truth = sphere_problem(40, event_noise=0.1)
    best_angle, best_difference = errors(solve(problem), truth)
    pairs = problem.pairs
    wrong = replace(pairs, threshold_on=pairs.threshold_on * told, threshold_off=pairs.threshold_off * told)
    solution = solve(replace(problem, pairs=wrong), thresholds=True)
    assert np.median(solution.threshold_gain, axis=0) == pytest.approx(1 / told, rel=0.03)
    assert np.std(np.log(solution.threshold_gain), axis=0).max() < 0.015  # there is no fixed pattern
    angle, difference = errors(solution, truth)
    assert angle.mean() < 1.2 * best_angle.mean()
    assert np.sqrt(np.mean(difference**2)) < 1.5 * np.sqrt(np.mean(best_difference**2))


def test_a_fixed_pattern_of_thresholds_is_found(rng):
    """Each pixel's own thresholds, told as one value; their sigmas are honest."""
    problem, truth = sphere_problem(40, event_noise=0.1)
    pattern = np.exp(rng.normal(0, [0.2, 0.1], (problem.n_pixel, 2)))
    pairs = problem.pairs
    told = [
        mi.Float((t.numpy() / p).astype(np.float32))
        for t, p in zip((pairs.threshold_on, pairs.threshold_off), pattern.T)
    ]
    unknown = replace(problem, pairs=replace(pairs, threshold_on=told[0], threshold_off=told[1]))
    solution = solve(unknown, thresholds=True)
    error = np.log(solution.threshold_gain / pattern)
    assert np.std(error, axis=0).max() < 0.04  # of 0.2 and 0.1
    assert np.sqrt(np.mean((error / solution.threshold_gain_sigma) ** 2)) == pytest.approx(1, abs=0.3)
    angle, _ = errors(solution, truth)
    ignorant, _ = errors(solve(unknown), truth)
    assert angle.mean() < 0.8 * ignorant.mean()
