"""What the loop over stages promises: how it ends, what it tells, and that it is recorded once for all sizes."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

from evsdr.model.lambert import LambertianRing
from evsdr.solve import learning, levenberg, loop, noise, recipes, stages
from evsdr.solve.neighbours import posterior, system
from evsdr.solve.neighbours.posterior import Priors
from evsdr.solve.pair_data import without
from evsdr.solve.recipes import Effort
from evsdr.solve.solution import NO_INFORMATION, STEPS_USED_UP
from tests.support.sphere import ALONE, errors, solve, sphere_problem

SHORT = (
    stages.Descend(3, 0.01, 0.3, 0.5),
    stages.Starts(1, 1, 0.01),
    stages.AllPairs(),
    stages.Descend(2, 0.01, terms=stages.ALL_TERMS),
    stages.SoftHorizon(1, 0.01),
    learning.PixelNoise(),
    learning.Neighbours(Priors(n_round=1, n_draw=1)),
)


@pytest.fixture(scope="module")
def small():
    return sphere_problem(12, event_noise=0.1)


def frozen_functions():
    """List all functions of the solver that are recorded."""
    modules = levenberg, noise, posterior, system
    return [f for module in modules for f in vars(module).values() if hasattr(f, "n_recordings")]


def test_a_recording_of_another_size_runs_the_same_kernels(small):
    """Frozen functions replay sizes that they don't get as arguments: growing and shrinking must change nothing."""
    larger, functions = sphere_problem(20, event_noise=0.1), frozen_functions()
    assert len(functions) > 10
    expected = []
    for problem, _ in (small, larger):
        for f in functions:
            f.clear()
        expected.append(solve(problem, recipe=SHORT))
    for problems in ((larger, small), (small, larger)):
        for f in functions:
            f.clear()
        found = [solve(problem, recipe=SHORT) for problem, _ in problems]
        assert max(f.n_recordings for f in functions) <= 4
        for one, other in zip(found, expected if problems[0] is small else expected[::-1]):
            assert np.median(np.abs(one.theta - other.theta)) < 1e-4
            off = np.abs(one.covariance - other.covariance)
            assert np.median(off / np.maximum(np.abs(other.covariance), 1e-12)) < 0.01


@pytest.mark.parametrize("after", [0, 20])
def test_a_solve_that_shall_end_soon_does(small, after):
    """Each stage that is left makes hardly a step, and what is known is said all the same."""
    problem, truth = small
    effort, told = Effort(priors=Priors(n_draw=1)), []
    solution = solve(
        problem, effort, thresholds=True, progress=lambda *what: told.append(what) or len(told) > after
    )
    whole = solve(problem, effort, thresholds=True)
    stages = len(recipes.whole(effort))
    assert [passed.stage for passed in solution.history] == [passed.stage for passed in whole.history]
    assert solution.n_step < after + 2 * stages < whole.n_step
    assert np.isfinite(solution.covariance).all() and np.isfinite(solution.theta).all()


def test_another_recording_compiles_nothing(small):
    """What is learnt reaches kernels as arrays."""
    other = sphere_problem(12, event_noise=0.1, seed=7)[0]
    for thresholds in (False, True):
        solve(small[0], Effort(), thresholds=thresholds)
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history()
            solve(other, Effort(), thresholds=thresholds)
            kernels = [kernel for kernel in dr.kernel_history() if "hash" in kernel]
        assert len(kernels) > 100
        assert all(kernel["cache_hit"] for kernel in kernels)


def test_steps_that_are_used_up_are_told(small):
    descend = stages.Descend(1, 0.1, 0.3, 0.5)
    short = solve(small[0], recipe=(descend, stages.AllPairs(), descend, *recipes.know(ALONE)))
    assert short.result == STEPS_USED_UP
    assert [passed.steps for passed in short.history] == [1, 0, 1, 0, 0]
    assert short.n_step == 2 and short.history[2].open > 0.5


def test_pixels_without_pairs_are_no_information(small):
    problem, _ = small
    nothing = without(problem.pairs, np.ones(problem.n_pixel, bool))
    solution = solve(replace(problem, pairs=nothing), recipe=SHORT)
    assert solution.result == NO_INFORMATION
    assert np.isfinite(solution.theta).all() and np.isfinite(solution.covariance).all()


def test_history_tells_the_stages(small):
    solution = solve(small[0], ALONE)
    names = [passed.stage for passed in solution.history]
    assert names[:2] == ["search", "all events"] and names[-2:] == ["noise", "neighbours"]
    assert sum(passed.steps for passed in solution.history) == solution.n_step
    assert all(passed.seconds >= 0 for passed in solution.history)
    costs = [p.mean_cost for p in solution.history if p.stage in ("refinement", "soft horizon")]
    assert costs[1] <= costs[0] + 1e-3


def test_a_solve_goes_on_from_a_solution(small):
    """With thresholds too; nothing is left to do."""
    problem, truth = small
    light = problem.illumination
    found = solve(problem, ALONE.at(0.01), thresholds=True)
    given = problem.pairs, light.constant_light, problem.grid, ALONE.width(True)
    data = loop.data_of(LambertianRing(light), *given)
    again = loop.solve(data, recipes.refine(ALONE), loop.resume(data, found))
    assert again.threshold_prior == pytest.approx(found.threshold_prior, abs=1e-3)
    assert np.median(np.abs(again.theta - found.theta)) < 1e-3
    assert errors(again, truth)[0].mean() == pytest.approx(errors(found, truth)[0].mean(), rel=0.05)
