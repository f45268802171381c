from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.metrics import angular_error_deg
from evsdr.model.lambert import LambertianRing
from evsdr.solve import levenberg, recipes
from evsdr.solve.loop import data_of, start_of
from evsdr.solve.loss import Loss
from evsdr.solve.system import PixelSystem, system_of
from evsdr.solve.unknowns import first_theta, normal_sigma_deg, to_theta
from tests.support.sphere import ALONE, PAIRS_ALONE, SPECTRUM, errors, solve, sphere_problem


def test_exact_events_give_exact_maps():
    problem, truth = sphere_problem(24, event_noise=0.0)
    angle, difference = errors(solve(problem), truth)
    assert np.median(angle) < 0.02
    assert np.mean(angle < 0.5) > 0.97
    assert np.median(np.abs(difference)) < 5e-4


def test_no_pixel_stays_where_a_better_start_exists():
    """Less than 0.5 % of the pixels end above the cost that a start from the truth reaches."""
    problem, truth = sphere_problem(40, event_noise=0.1)
    reached = solve(problem)
    start = to_theta(truth, np.tile(SPECTRUM, (problem.n_pixel, 1)), mi.Float)
    best = solve(problem, start=start, recipe=recipes.after_light(ALONE))
    assert np.mean(reached.cost > best.cost + 1) < 0.005


def test_silence_informs():
    """LEDs that cause no event say so: dark bands and normals are known better."""
    spectrum = np.array([0.03, 0.02, 0.04, 0.5, 0.03, 0.6, 0.03, 0.02])
    problem, truth = sphere_problem(40, event_noise=0.1, threshold=0.4, spectrum=spectrum)
    angle, difference = errors(solve(problem), truth, spectrum)
    deaf_angle, deaf_difference = errors(solve(problem, recipe=PAIRS_ALONE), truth, spectrum)
    dark = spectrum < 0.1
    assert np.abs(difference[:, dark]).mean() < 0.8 * np.abs(deaf_difference[:, dark]).mean()
    assert angle.mean() < 0.7 * deaf_angle.mean()


def test_sigma_of_slopes_is_the_angle_that_sampling_shows(rng):
    p, q, covariance = 0.8, -0.5, np.array([[4e-4, 1e-4], [1e-4, 2e-4]])
    slopes = rng.multivariate_normal([p, q], covariance, 20000)
    normal = np.column_stack([-slopes, np.ones(len(slopes))])
    sampled = np.sqrt(np.mean(angular_error_deg(normal, np.array([-p, -q, 1.0])) ** 2))
    sigma = normal_sigma_deg(np.array([p]), np.array([q]), covariance[None])[0]
    assert sigma == pytest.approx(sampled, rel=0.02)


def test_a_step_hears_the_events_once():
    """What is summed over the pixels is not evaluated apart from what they keep."""
    problem, _ = sphere_problem(8, event_noise=0.1)
    light, n = problem.illumination, problem.n_pixel
    data = data_of(LambertianRing(light), problem.pairs, light.constant_light, problem.grid, 2.0)
    theta = first_theta(np.tile([0.0, 0.0, 1.0], (n, 1)), light.n_band, False, mi.Float)
    system = system_of(data, start_of(data, theta, None), Loss(2.0, True, True))
    terms, (damping, idle, tolerance) = levenberg.evaluate(system, theta), map(mi.Float, (0.01, 0.0, 0.1))
    damping, idle = damping + dr.zeros(mi.Float, n), idle + dr.zeros(mi.Float, n)
    dr.eval(theta, terms, damping, idle, tolerance)
    flags = dr.JitFlag.KernelHistory, dr.JitFlag.KernelFreezing
    with dr.scoped_set_flag(flags[0], True), dr.scoped_set_flag(flags[1], False):
        dr.kernel_history_clear()
        dr.eval(levenberg.step(system, theta, terms, damping, idle, tolerance))
        dr.sync_thread()
        code = [kernel["ir"].getvalue() for kernel in dr.kernel_history([dr.KernelType.JIT])]
    for loop in ("event terms", "silence terms"):
        assert sum(f"Symbolic loop: {loop}" in text for text in code) == 1


def test_pixels_that_have_settled_rest(monkeypatch):
    """What moves on are the others, in another order: costs are those of all pixels moving together, and fewer pairs are heard."""
    problem, _ = sphere_problem(48, event_noise=0.1)
    together, heard = solve(problem), []
    monkeypatch.setattr(levenberg, "FEWEST", 64)
    at = PixelSystem.at

    def looked(system, index):
        heard.append(len(index))
        return at(system, index)

    monkeypatch.setattr(PixelSystem, "at", looked)
    apart = solve(problem)
    assert max(heard) == problem.n_pixel and min(heard) < 0.5 * problem.n_pixel
    assert np.mean(np.abs(apart.cost - together.cost) > 0.3) < 0.02
    assert np.mean(apart.cost) == pytest.approx(np.mean(together.cost), abs=0.2)
    assert np.median(np.abs(apart.theta - together.theta)) < 0.01


def test_what_some_pixels_found_is_put_in_its_place():
    whole = levenberg.placed([[mi.Float(5, 6, 7)]], mi.UInt32(2, 0, 1), 3)
    assert whole[0][0].numpy().tolist() == [6, 7, 5]
    part = levenberg.placed([[mi.Float(9)]], mi.UInt32(1), 3, whole)
    assert part[0][0].numpy().tolist() == [6, 9, 5] and whole[0][0].numpy().tolist() == [6, 7, 5]


def test_neighbours_in_the_order_have_alike_many_pairs(rng):
    """Each block of pixels stays together."""
    count = rng.integers(0, 300, 5000)
    pairs = SimpleNamespace(counts=count, first=mi.UInt32(0))
    order = levenberg.by_count(SimpleNamespace(pairs=pairs)).numpy()
    blocks = np.split(order, np.arange(levenberg.BLOCK, 5000, levenberg.BLOCK))
    for i, block in enumerate(blocks):
        assert set(block // levenberg.BLOCK) == {i} and (np.diff(count[block]) <= 0).all()
    assert sum(len(block) for block in blocks) == len(set(order)) == 5000
    few = SimpleNamespace(counts=count[:100])
    assert levenberg.by_count(SimpleNamespace(pairs=few)) is None
