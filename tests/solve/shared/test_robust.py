"""Sigmas that hold what a model has wrong in common for a kind of events."""

import numpy as np
import pytest

from evsdr.records import Schedule
from evsdr.solve.shared.robust import N_PART, N_WAIT, covariance, kinds
from tests.support.shared_unknowns import Case

NAMES = ("powers", "refractory", "thresholds")


def events(rng, n=400):
    gap = rng.uniform(0.1, 2, n)
    return np.array([0, n]), np.cumsum(gap) % 6, gap, rng.choice([-1, 1], n), np.ones(n, bool), np.zeros(1)


def test_kinds_are_known_before_an_event_fires(rng):
    """Else a threshold that happens to be low would make events of a kind that comes soon."""
    given = events(rng)
    before = kinds(given)
    assert before.min() >= 0 and N_WAIT * N_PART < len(np.unique(before)) <= 2 * N_WAIT * N_PART
    k = 200
    for i in range(1, 4):
        changed = [np.array(part) for part in given]
        changed[i][k] = {1: 0.01, 2: 0.05, 3: -given[3][k]}[i]
        after = kinds(tuple(changed))
        assert after[k] == before[k]
    assert kinds(tuple(changed))[k + 1 :].tolist() != before[k + 1 :].tolist()


def test_no_events_are_no_kinds():
    assert len(kinds((np.zeros(1, int), *(np.zeros(0) for _ in range(4)), np.zeros(0)))) == 0


def test_what_kinds_disagree_on_is_less_known(rng):
    """Two pixels, two kinds that pull the first of two shared unknowns apart, once maps have followed."""
    slope, response = np.zeros((2, 2, 3)), np.zeros((2, 1, 2))
    known = np.diag([4.0, 9.0])
    np.testing.assert_allclose(
        covariance(slope, response, np.eye(2), known), np.diag([1 / 4, 1 / 9]), atol=1e-15
    )
    slope[:, 0, 1], slope[:, 1, 1] = 1.0, -1.0
    found = covariance(slope, response, np.eye(2), known)
    np.testing.assert_allclose(found, np.diag([1 / 4 + 2 * (2 / 4) ** 2, 1 / 9]))
    slope[:, 0, 0], slope[:, 1, 0], response[:, 0, 0] = 1.0, -1.0, -1.0  # maps take all of it
    np.testing.assert_allclose(covariance(slope, response, np.eye(2), known), np.diag([1 / 4, 1 / 9]))


@pytest.mark.parametrize("event_noise", [0.02, 0.1])
def test_where_the_model_is_true_sigmas_are_hardly_larger(event_noise, monkeypatch):
    """By as much as the scatter of single events is counted twice, not by kinds that follow what fired."""
    grown = []

    def watched(slope, response, vectors, complement):
        found = covariance(slope, response, vectors, complement)
        grown.append(np.sqrt(np.diag(found) / np.diag(np.linalg.inv(complement))))
        return found

    monkeypatch.setattr("evsdr.solve.shared.infer.covariance", watched)
    Case.sphere(event_noise=event_noise).infer(NAMES)
    assert 1 < np.median(grown[0]) < 1.6 and grown[0].max() < 2.2


def test_noise_that_is_not_the_models_leaves_truths_within_three_sigmas():
    """Noise of simulated pixels is linear between its steps, which no second pole is: the refractory period pays."""
    schedule = Schedule(np.arange(24, dtype=np.int32), 20_000.0, 1.0)
    case = Case.sphere(
        size=28, schedule=schedule, event_noise=0.02, cutoff_hz=3000.0, photon_rate_per_us=100.0
    )
    found = case.infer()
    value, sigma = (of.refractory * schedule.slot_us for of in (found.rig, found.sigma))
    assert 10 < abs(value - 52) < 3 * sigma < 90
    assert np.abs(found.rig.log_threshold / found.sigma.log_threshold).max() < 3
    assert np.sqrt(np.mean((found.rig.log_power / found.sigma.log_power) ** 2)) < 1.5
