"""Numbers that are learnt from the pixels: noise, and the distribution of thresholds."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.lambert import LambertianRing
from evsdr.solve import loop
from evsdr.solve.learning import CURVED_LIGHT, curved_factors
from evsdr.solve.noise import NOISE_RANGE
from evsdr.solve.recipes import Effort
from evsdr.solve.stages import softness_at
from evsdr.solve.tuning import Tuning
from evsdr.solve.unknowns import normal_sigma_deg, to_theta
from tests.support.sphere import errors, solve, sphere_problem


def test_noise_is_measured_and_sigma_is_honest():
    """Angles relative to their sigma have a mean square of about 1: sigma is their root mean square."""
    problem, truth = sphere_problem(40, event_noise=0.1)
    effort = Effort(priors=None, tuning=Tuning(curved=False))  # its light is that of one normal per pixel
    solution = solve(problem, effort)
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


def test_pixels_that_are_curved_count_as_noisier():
    """By the events of a slot: what is wrong with its light is wrong in each round."""
    problem, truth = sphere_problem(24, event_noise=0.1)
    light = problem.illumination
    data = loop.data_of(LambertianRing(light), problem.pairs, light.constant_light, problem.grid, 2.0)
    theta = to_theta(truth[:, :3], truth[:, 3:], type(light.constant_light))
    state = replace(loop.start_of(data, theta), noise=0.1, per_slot=np.full(problem.n_pixel, 6.0))
    factor, softness = curved_factors(data, state), softness_at(data, theta).numpy()
    np.testing.assert_allclose(factor**2, 1 + 6 * CURVED_LIGHT**2 * softness**2 / 0.01, rtol=1e-4)
    rim = truth[:, 2] < 0.4
    assert factor[rim].mean() > factor[~rim].mean() > 1
    once = replace(state, per_slot=np.ones(problem.n_pixel))
    assert (curved_factors(data, once) < factor).all()
    unknown = replace(state, noise=NOISE_RANGE[0])
    assert (curved_factors(data, unknown) == 1).all()
