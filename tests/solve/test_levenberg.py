from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.metrics import angular_error_deg
from evsdr.solve import recipes
from evsdr.solve.unknowns import normal_sigma_deg, to_theta
from tests.support.sphere import ALONE, PAIRS_ALONE, SPECTRUM, errors, solve, sphere_problem


def test_exact_events_give_exact_maps():
    problem, truth = sphere_problem(24, event_noise=0.0)
    angle, difference = errors(solve(problem), truth)
    assert np.median(angle) < 0.02
    assert np.mean(angle < 0.5) > 0.97
    assert np.median(np.abs(difference)) < 5e-4


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


def test_no_pixel_stays_where_a_better_start_exists():
    """Less than 0.5 % of the pixels end above the cost that a start from the truth reaches."""
    problem, truth = sphere_problem(40, event_noise=0.1)
    reached = solve(problem)
    start = to_theta(truth, np.tile(SPECTRUM, (problem.n_pixel, 1)), mi.Float)
    best = solve(problem, start=start, recipe=recipes.after_light(ALONE))
    assert np.mean(reached.cost > best.cost + 1) < 0.005


def test_silence_informs():
    """LEDs that cause no event say so: dark bands are known far better."""
    spectrum = np.array([0.03, 0.02, 0.04, 0.5, 0.03, 0.6, 0.03, 0.02])
    problem, truth = sphere_problem(40, event_noise=0.1, threshold=0.4, spectrum=spectrum)
    _, difference = errors(solve(problem), truth, spectrum)
    _, deaf_difference = errors(solve(problem, recipe=PAIRS_ALONE), truth, spectrum)
    dark = spectrum < 0.1
    assert np.abs(difference[:, dark]).mean() < 0.7 * np.abs(deaf_difference[:, dark]).mean()


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


def test_sigma_of_slopes_is_the_angle_that_sampling_shows(rng):
    p, q, covariance = 0.8, -0.5, np.array([[4e-4, 1e-4], [1e-4, 2e-4]])
    slopes = rng.multivariate_normal([p, q], covariance, 20000)
    normal = np.column_stack([-slopes, np.ones(len(slopes))])
    sampled = np.sqrt(np.mean(angular_error_deg(normal, np.array([-p, -q, 1.0])) ** 2))
    sigma = normal_sigma_deg(np.array([p]), np.array([q]), covariance[None])[0]
    assert sigma == pytest.approx(sampled, rel=0.02)
