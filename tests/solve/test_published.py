import drjit as dr
import mitsuba as mi
import numpy as np

from evsdr.metrics import angular_error_deg
from evsdr.solve import published
from tests.support.sphere import SPECTRUM, sphere_problem


def test_adam_descends_to_the_sphere_and_keeps_its_constraints():
    size = 24
    problem, truth = sphere_problem(size, event_noise=0.1)
    start = np.tile([0.0, 0.0, 1.0], (problem.n_pixel, 1))
    normal, reflectance = published.solve(
        problem.illumination,
        problem.pairs,
        start,
        problem.pixel,
        (size, size),
        published.AdamSettings(n_step=200),
    )
    assert angular_error_deg(normal, truth).mean() < 0.25 * angular_error_deg(start, truth).mean()
    assert np.abs(reflectance - SPECTRUM).mean() < 0.1
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-5)
    assert normal[:, 2].min() > 0
    assert reflectance.min() >= 0


def test_the_seed_sets_the_start():
    problem, _ = sphere_problem(16, event_noise=0.1)
    start = np.tile([0.0, 0.0, 1.0], (problem.n_pixel, 1))
    settings = published.AdamSettings(n_step=3)
    runs = [
        published.solve(problem.illumination, problem.pairs, start, problem.pixel, (16, 16), settings, seed)[
            1
        ]
        for seed in (0, 0, 1)
    ]
    np.testing.assert_allclose(runs[0], runs[1], rtol=1e-4)  # sums of atomic additions are not ordered
    assert np.abs(runs[0] - runs[2]).max() > 1e-3


def test_blur_is_a_masked_gaussian(rng):
    mask = rng.uniform(size=(20, 25)) > 0.3
    values = rng.normal(size=mask.sum()).astype(np.float32)
    settings = published.AdamSettings(blur_size=5, blur_sigma=1.5)
    place = mi.UInt32(np.flatnonzero(mask).astype(np.uint32))
    constant, blurred = published.blur(
        [dr.full(mi.Float, 3.0, mask.sum()), mi.Float(values)], place, mask.shape, settings
    )
    np.testing.assert_allclose(constant.numpy(), 3.0, rtol=1e-5)
    rows, columns = np.nonzero(mask)
    i = len(rows) // 2
    dy, dx = rows - rows[i], columns - columns[i]
    weight = np.exp(-(dx**2 + dy**2) / (2 * 1.5**2)) * (abs(dx) <= 2) * (abs(dy) <= 2)
    np.testing.assert_allclose(blurred.numpy()[i], weight @ values / weight.sum(), rtol=1e-4, atol=1e-6)


def test_down_weighting_starts_half_way_and_does_no_harm():
    """Narrow weights would let the contrast collapse; those of three standard deviations don't."""
    problem, truth = sphere_problem(16, event_noise=0.05, dead=(3,))
    start = np.tile([0.0, 0.0, 1.0], (problem.n_pixel, 1))
    given = problem.illumination, problem.pairs, start, problem.pixel, (16, 16)
    plain, robust = (
        published.solve(*given, published.AdamSettings(n_step=400, robust=r))[0] for r in (None, 3.0)
    )
    assert np.abs(plain - robust).max() > 0.01
    assert angular_error_deg(robust, truth).mean() < 1.05 * angular_error_deg(plain, truth).mean()
