"""Several readings of the same events, tried in one solve: the right one costs least."""

import mitsuba as mi
import numpy as np

from evsdr.solve import trial
from tests.support.sphere import sphere_recording
from tests.support.worlds import problem_of


def test_the_right_reading_costs_least():
    """The order of the LEDs as it is, and with two neighbours swapped."""
    recording, light, normal, mask = sphere_recording(16, event_noise=0.1)
    order = np.arange(24)
    swapped = order.copy()
    swapped[[4, 5]] = 5, 4
    problems = [problem_of(recording, light, mask, o) for o in (order, swapped)]
    row = np.arange(10, problems[0].n_pixel, 6, dtype=np.uint32)
    cases = [problem.pairs.at(mi.UInt32(row)) for problem in problems]
    costs = trial.costs(cases, problems[0].illumination, row, False)
    assert costs.shape == (2, len(row)) and costs[0].sum() < costs[1].sum() - 50
    found = trial.solve(cases[:1], problems[0].illumination, row, False)
    assert found.cost.shape == (len(row),)
    p, q = found.theta[:, 0], found.theta[:, 1]
    cosine = np.sum(normal[mask][row] * np.column_stack([-p, -q, np.ones_like(p)]), 1) / np.sqrt(
        1 + p * p + q * q
    )
    assert np.degrees(np.arccos(np.median(cosine))) < 1.5


def test_what_each_reading_leaves_unexplained():
    recording, light, _, mask = sphere_recording(16, event_noise=0.1)
    swapped = np.arange(24)
    swapped[[4, 15]] = 15, 4
    problems = [problem_of(recording, light, mask, o) for o in (np.arange(24), swapped)]
    row = np.arange(10, problems[0].n_pixel, 6, dtype=np.uint32)
    cases = [problem.pairs.at(mi.UInt32(row)) for problem in problems]
    for thresholds in (False, True):
        right, wrong = trial.readings(cases, problems[0].illumination, row, thresholds)
        assert right.theta.shape == (len(row), 10) and len(right.residual) == len(right.pixel)
        assert set(right.pixel) == set(range(len(row)))
        assert np.median(np.abs(right.residual)) < 0.12
        assert np.mean(np.abs(wrong.residual) > 0.5) > 10 * np.mean(np.abs(right.residual) > 0.5)
        assert (right.gain is not None) == thresholds
    np.testing.assert_allclose(np.median(right.gain, axis=0), 1, atol=0.1)
