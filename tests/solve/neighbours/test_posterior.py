from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.arrays import owned
from evsdr.solve import grid as g
from evsdr.solve.neighbours import system as joint
from evsdr.solve.neighbours.posterior import Priors, squared_pulls
from evsdr.solve.neighbours.priors import Form, Learnt, smooth_reflectance
from evsdr.solve.noise import IGNORED
from evsdr.solve.recipes import Effort
from evsdr.solve.tuning import Tuning
from evsdr.solve.unknowns import normal_sigma_deg
from tests.support.sphere import ALONE, SPECTRUM, errors, solve, sphere_problem

WITH_PRIORS = Effort(
    tuning=Tuning(curved=False)
)  # the light of these spheres is that of one normal per pixel


@pytest.fixture(scope="module")
def noisy_sphere():
    return sphere_problem(48, event_noise=0.1)


def test_neighbours_halve_the_error_and_sigma_knows(noisy_sphere):
    problem, truth = noisy_sphere
    alone, together = solve(problem, ALONE), solve(problem, WITH_PRIORS)
    angle, difference = errors(together, truth)
    single_angle, single_difference = errors(alone, truth)
    assert angle.mean() < 0.4 * single_angle.mean()
    assert np.sqrt(np.mean(difference**2)) < 0.5 * np.sqrt(np.mean(single_difference**2))
    sigma = normal_sigma_deg(*together.theta[:, :2].T.astype(float), together.covariance[:, :2, :2])
    inner = truth[:, 2] > 0.4
    assert 0.6 < np.sqrt(np.mean((angle / sigma)[inner] ** 2)) < 1.4


@pytest.mark.parametrize(
    ("part", "what"),
    [("normal", "angle"), ("integrable", "angle"), ("reflectance", "colour"), ("spectra", "colour")],
)
def test_each_prior_helps_by_itself(noisy_sphere, part, what):
    problem, truth = noisy_sphere
    effort = replace(ALONE, priors=Priors(parts=(part,), n_draw=0))
    solution = solve(problem, effort)
    assert list(solution.prior_scale) == ["rank" if part == "spectra" else part]
    index = ("angle", "colour").index(what)
    error, single = (np.abs(errors(s, truth)[index]).mean() for s in (solution, solve(problem, ALONE)))
    assert error < 0.93 * single


def test_edges_stay():
    """Two materials side by side: the step between them is not blurred."""
    light_and_dark = np.where(np.arange(48)[None, :, None] < 24, SPECTRUM, 0.3 * SPECTRUM[::-1])
    problem, truth = sphere_problem(
        48, event_noise=0.1, spectrum=np.broadcast_to(light_and_dark, (48, 48, 8))
    )
    column = problem.pixel % 48
    spectrum = light_and_dark[0][column]
    edge = np.isin(column, (22, 23, 24, 25))
    single = errors(solve(problem, ALONE), truth, spectrum)[1]
    together = errors(solve(problem, WITH_PRIORS), truth, spectrum)[1]
    assert np.abs(together[edge]).mean() < 0.2 * np.abs(single[edge]).mean()
    assert np.abs(together[~edge]).mean() < 0.3 * np.abs(single[~edge]).mean()


def test_white_pixels_learn_their_scale_from_those_that_can_tell_it():
    """Inside the ring's cone all LEDs are far brighter than the constant light: each pixel alone stays dark."""
    white = np.full(8, 0.8)
    problem, truth = sphere_problem(40, event_noise=0.05, spectrum=white)
    inside = truth[:, 2] > 0.9
    single, together = (
        np.abs(errors(solve(problem, e), truth, white)[1][inside]).mean() for e in (ALONE, WITH_PRIORS)
    )
    assert single > 0.3 and together < 0.05


def test_pixels_whose_events_contradict_the_light_learn_from_their_neighbours(noisy_sphere, rng):
    """A tenth of the pixels fires at random: they end as the others, if less well known."""
    problem, truth = noisy_sphere
    phases = problem.pairs.phases.numpy().reshape(-1, 2)
    hot = rng.random(problem.n_pixel) < 0.1
    of_hot = np.repeat(hot, problem.pairs.counts)
    phases[of_hot, 0] = rng.uniform(0, 24, of_hot.sum())
    phases[of_hot, 1] = (1 + rng.uniform(0, 24, of_hot.sum())) * rng.choice([-1, 1], of_hot.sum())
    spoilt = replace(
        problem, pairs=replace(problem.pairs, phases=mi.Float(phases.astype(np.float32).ravel()))
    )
    solution = solve(spoilt, WITH_PRIORS)
    assert np.mean((solution.noise_factor == IGNORED) == hot) > 0.98
    angle, _ = errors(solution, truth)
    assert solution.noise == pytest.approx(0.1, rel=0.15)
    assert np.median(angle[hot]) < 2
    assert angle[~hot].mean() < 1


def test_nothing_to_learn_from_is_no_error():
    """Four pixels of one row: no prior finds a difference it could learn from, and none fails."""
    problem, _ = sphere_problem(48, event_noise=0.1)
    few = np.zeros(48 * 48, bool)
    few[problem.pixel[500:503]] = True
    grid = g.make_grid(few.reshape(48, 48), mi.UInt32)
    index = mi.UInt32(500, 501, 502)
    small = replace(problem, pixel=problem.pixel[500:503], grid=grid, pairs=problem.pairs.at(index))
    solution = solve(small, WITH_PRIORS)
    assert np.isfinite(solution.theta).all() and np.isfinite(solution.covariance).all()


def test_sigma_holds_what_a_prior_pulls_away():
    """A bright tile beside a dark one, of one band, and data that hardly tell its scale: a smooth prior pulls it down."""
    mask, precision, told = np.ones((6, 12), bool), 4.0, 0.3
    links = g.make_grid(mask, mi.UInt32).links
    bright = (np.arange(12) < 6)[None, :].repeat(6, axis=0).ravel()
    truth = np.where(bright, np.log(0.5), np.log(0.03))
    known = np.where(bright, told, 30.0)
    weights = [np.where(s.valid(links).numpy(), 1.0, 0.0) for s in (g.SECOND_X, g.SECOND_Y)]
    form = Form(
        Learnt.of(smooth_reflectance(1), np.eye(1) / precision, mi.Float), _arrays(weights), jacobian=None
    )
    # lower triangles of the pixels' matrices: slopes are known, and no one asks for them
    own = [np.ones(72), np.zeros(72), np.ones(72), np.zeros(72), np.zeros(72), known]
    nothing = dr.zeros(mi.Float, 72)
    dr.make_opaque(nothing)
    matrix, lower, pivot, _ = joint.make_system([form], _arrays(own), nothing, links)
    system = joint.JointSystem(matrix, [form], lower, pivot)
    found = joint.solve(system, _arrays([np.zeros(72), np.zeros(72), known * truth]), links, 1e-4)
    off = found[2].numpy() - truth
    assert off[bright].mean() < -0.1
    pulled = squared_pulls(system, found, links)
    ratio = np.sqrt(pulled[:, 2, 2])[bright] / np.abs(off[bright])
    assert 0.3 < np.median(ratio) < 1.0
    assert not pulled[:, :2].any()


def _arrays(values):
    return [owned(mi.Float, np.asarray(v, np.float32)) for v in values]
