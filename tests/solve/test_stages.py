"""Stages that move the unknowns: when they end, and what they take over."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.progress import silent
from evsdr.solve.solution import SETTLED
from evsdr.solve.stages import AllPairs, Descend, Starts
from evsdr.solve.unknowns import to_normal
from tests.support.sphere import ALONE, searched_from, solve, sphere_problem


@pytest.fixture(scope="module")
def small():
    return sphere_problem(12, event_noise=0.1)


def test_stages_end_by_tolerance(small):
    """Costs would not tell: each solve learns its own noise, by which they are counted."""
    problem, _ = small
    rough, exact, best = (solve(problem, ALONE.at(tolerance)) for tolerance in (100.0, 0.01, 1e-5))
    assert rough.result == SETTLED
    assert rough.n_step < 0.75 * exact.n_step
    away = [np.abs(solution.theta - best.theta).mean() for solution in (rough, exact)]
    assert away[1] < 0.5 * away[0]


def test_a_stuck_pixel_takes_over_what_its_neighbours_found(small):
    problem, truth = small
    data, start = searched_from(problem)
    state = Descend(30, 0.01, softness=0.3)(data, start, silent)
    state = Descend(30, 0.01)(data, state, silent)
    row = int(np.argmax(truth[:, 2]))  # frontal
    theta = np.stack([t.numpy() for t in state.theta])
    theta[:2, row] = 20.0, 0.0  # grazing: no LED there is lit, and no descent leads back
    stuck = replace(state, theta=[mi.Float(t) for t in theta])
    stuck = Descend(0, 0.01)(data, stuck, silent)
    healed = Starts(1, 5, 0.01)(data, stuck, silent)
    angle = [
        np.degrees(np.arccos(to_normal(np.stack([t.numpy() for t in s.theta], -1))[row] @ truth[row]))
        for s in (stuck, healed)
    ]
    assert angle[0] > 60 and angle[1] < 5
    assert (healed.terms[0].numpy() <= stuck.terms[0].numpy()).all()


def test_all_pairs_count_after_the_search(small):
    data, start = searched_from(small[0], n_early=5)
    assert start.pairs.counts.max() == 5
    assert AllPairs()(data, start, silent).pairs.counts.max() == data.pairs.counts.max() > 5
