"""The search on few pixels: which they are, and what the others take over."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.metrics import angular_error_deg
from evsdr.solve import coarse
from evsdr.solve.coarse import Coarse, lattice, thinned
from evsdr.solve.recipes import Effort, rough
from evsdr.solve.unknowns import to_normal
from tests.support.sphere import searched_from, solve, sphere_problem


@pytest.fixture(scope="module")
def small():
    return sphere_problem(16, event_noise=0.1)


@pytest.fixture
def sparse(monkeypatch):
    monkeypatch.setattr(coarse, "ENOUGH", 30)


def test_a_lattice_has_its_own_neighbours(small):
    problem, _ = small
    few, _ = thinned(*searched_from(problem), 2)
    mask = problem.grid.mask
    place = problem.pixel[lattice(mask, 2)]
    assert (place % 16 % 2 == 0).all() and (place // 16 % 2 == 0).all()
    np.testing.assert_array_equal(few.pairs.counts, problem.pairs.counts[lattice(mask, 2)])
    right, there = few.grid.links.index["right"].numpy(), few.grid.links.exists["right"].numpy()
    assert (place[right] - place)[there].tolist() == [2] * np.count_nonzero(there)


def test_all_take_over_what_the_nearest_found(small, sparse):
    problem, _ = small
    data, start = searched_from(problem)

    def stage(few, state, progress):
        number = np.flatnonzero(lattice(data.grid.mask, 2)).astype(np.float32)
        return replace(state, theta=[type(t)(number) for t in state.theta], noise=0.25, n_step=3)

    found = Coarse((stage,))(data, start, None)
    teacher = problem.pixel[found.theta[0].numpy().astype(int)]
    away = np.hypot(teacher % 16 - problem.pixel % 16, teacher // 16 - problem.pixel // 16)
    assert away.max() <= 2.5 and (away[lattice(data.grid.mask, 2)] == 0).all()
    assert (found.noise, found.n_step) == (0.25, 3) and found.pairs is start.pairs


def test_it_ends_where_a_search_of_all_does(small, monkeypatch):
    problem, truth = small
    errors = []
    for enough in (10**6, 30):
        monkeypatch.setattr(coarse, "ENOUGH", enough)
        solution = solve(problem, Effort().at(0.1), recipe=rough(Effort().at(0.1)))
        errors.append(angular_error_deg(to_normal(solution.theta), truth))
    assert np.median(errors[1]) < 1.1 * np.median(errors[0])
