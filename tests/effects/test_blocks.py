"""Blocks of pixels that stand for all."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from evsdr.effects.blocks import BLOCK, block_of, sample_of
from evsdr.model.gloss import RoughCoating
from evsdr.model.lambert import signals_of
from tests.support.sphere import sphere_problem


def test_blocks_until_there_are_enough():
    problem, _ = sphere_problem(48, event_noise=0.1, n_round=1)
    solution = SimpleNamespace(at=lambda row: row)
    fitted = SimpleNamespace(problem=problem, solution=solution, maps=None)
    assert sample_of(fitted, 10**6) is fitted
    some = sample_of(fitted, 400)
    assert 400 <= some.problem.n_pixel < 400 + BLOCK**2
    whole, kept = (block_of((48, 48)).ravel()[p.pixel] for p in (problem, some.problem))
    assert set(np.bincount(kept)) <= {0, *np.bincount(whole)}  # each block whole or not at all
    np.testing.assert_array_equal(problem.pixel[some.solution], some.problem.pixel)
    np.testing.assert_array_equal(np.flatnonzero(some.problem.grid.mask), some.problem.pixel)
    np.testing.assert_array_equal(some.problem.pairs.counts, problem.pairs.counts[some.solution])


def test_some_pixels_keep_their_surface():
    """Lobes and views of each pixel go with it, those of all stay."""
    problem, _ = sphere_problem(24, event_noise=0.1, n_round=1)
    n = problem.n_pixel
    Float = type(problem.illumination.constant_light)
    shape = Float(np.linspace(0.1, 0.3, n).astype(np.float32))
    problem = replace(problem, lobe=RoughCoating(shape, Float(1.0)), rough=Float(0.3))
    fitted = SimpleNamespace(problem=problem, solution=SimpleNamespace(at=lambda row: row), maps=None)
    some = sample_of(fitted, 50)
    assert 50 <= some.problem.n_pixel < n
    np.testing.assert_array_equal(some.problem.lobe.shape.numpy(), shape.numpy()[some.solution])
    assert some.problem.lobe.strength.numpy() == [1] and some.problem.rough.numpy() == np.float32([0.3])
    theta = np.zeros((n, 2 + problem.illumination.n_band), np.float32)
    expected = signals_of(problem.model, theta)[:, some.solution]
    np.testing.assert_allclose(signals_of(some.problem.model, theta[some.solution]), expected, rtol=1e-5)
