"""Blocks of pixels that stand for all."""

from types import SimpleNamespace

import numpy as np

from evsdr.effects.blocks import BLOCK, block_of, sample_of
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
