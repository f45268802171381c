"""Events by chance are told from those by light by how far the light has gone; what is left out ends no pair."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.solve.background import Activity, activity_of, least_residual, without_chance
from tests.support.sphere import solve, sphere_problem


@pytest.mark.parametrize("share", [0.03, 0.2])
@pytest.mark.parametrize("scatter", [0.05, 0.2])
def test_either_is_as_likely_at_the_least_residual(rng, share, scatter):
    """Where as many of the one as of the other have that residual; it is found whatever the scatter is, of half of them."""
    n = 40_000
    light, chance = scatter * rng.standard_normal(int(n * (1 - share))), rng.uniform(-2, 0, int(n * share))
    least = least_residual(np.concatenate([light, chance]), Activity(share, 1.0))
    density = np.exp(-0.5 * (least / scatter) ** 2) / scatter / np.sqrt(2 * np.pi)
    assert np.log((1 - share) * density / (0.5 * share)) == pytest.approx(0, abs=0.6)
    assert np.mean(light < least) < 0.02 and np.mean(chance < least) > 0.65


def test_nothing_is_below_where_nothing_scatters():
    assert least_residual(np.zeros(5), Activity(0.1, 1.0)) == -np.inf


def test_by_the_light_of_a_fit_events_are_told_apart(rng):
    """Of a sphere, with some polarities turned round by chance."""
    problem, _ = sphere_problem(16, 0.05)
    solution = solve(problem)
    assert activity_of(problem, solution).share == 0
    phases = problem.pairs.phases.numpy().reshape(-1, 2).copy()
    wrong = rng.random(len(phases)) < 0.05
    phases[wrong, 1] *= -1
    spoilt = replace(problem, pairs=replace(problem.pairs, phases=mi.Float(phases.ravel())))
    activity = activity_of(spoilt, solution)
    assert activity.share == pytest.approx(0.1, rel=0.2) and activity.clumped < 2
    kept = without_chance(spoilt, solution, activity)
    assert kept.counts.sum() == pytest.approx(np.count_nonzero(~wrong), rel=0.01)
    first, last, left = kept.first.numpy(), kept.last.numpy(), kept.phases.numpy().reshape(-1, 2)
    old_first, old_last = problem.pairs.first.numpy(), problem.pairs.last.numpy()
    for a, b, c, d in zip(first, last, old_first, old_last):
        told = {tuple(row): flipped for row, flipped in zip(phases[c:d].tolist(), wrong[c:d])}
        found = [told[tuple(row)] for row in left[a:b].tolist()]  # pairs of this pixel only
        assert not any(found)
