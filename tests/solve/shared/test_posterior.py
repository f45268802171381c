"""The posterior of maps and of what pixels share: its steps, what it leaves open, and which pixels it hears."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize

from evsdr.solve.shared.infer import _between, _doubted, _no_lag, _posterior
from evsdr.solve.shared.pixels import QUICKEST_US, vector_of
from evsdr.solve.shared.posterior import LEAST_LEFT, MOST_COUNTED, SLACK, Start
from evsdr.solve.shared.rig import NOT_NEGATIVE, Told, across
from evsdr.solve.threshold_spread import LARGEST_VARIANCE
from evsdr.solve.unknowns import TIED, to_normal, weak_prior
from tests.support.shared_unknowns import N_LED, Case

NAMES = ("powers", "directions")


@pytest.fixture(scope="module")
def case():
    return Case.sphere(size=16, event_noise=0.02)


@pytest.fixture(scope="module")
def posterior(case):
    theta = case.solution.theta[case.row].astype(float)
    start = Start(theta, case.told, np.ones(2), case.solution.noise)
    return _posterior(case.pixels, start, case.told, Told(), NAMES)


@pytest.fixture(scope="module")
def point(case, posterior):
    theta = case.solution.theta[case.row].astype(float)
    return posterior.at(theta, posterior.basis.vectors.T @ case.told.vector)


def mapped(case, theta, m):
    """Give maps whose normals are mapped linearly, and the rig under which they look alike."""
    n = to_normal(theta) @ m.T
    out = np.column_stack([-n[:, 0] / n[:, 2], -n[:, 1] / n[:, 2], theta[:, 2:]])
    out[:, 2:] += np.log(np.linalg.norm(n, axis=1))[:, None]
    told = np.array([vector_of(d) for d in case.pixels.light.direction])
    light = told @ np.linalg.inv(m)
    length = np.linalg.norm(light, axis=1)
    tilt = [across(d) @ v / (d @ v) for d, v in zip(told, light)]
    gain, band = np.log(length), np.array(case.pixels.light.band)
    mean = np.bincount(band, gain) / np.bincount(band)
    out[:, 2:] += mean
    return out, replace(case.told, log_power=gain - mean[band], tilt=np.array(tilt))


@pytest.mark.parametrize("k", range(8))
def test_a_linear_map_of_normals_is_left_open(case, posterior, point, k):
    """Powers, directions and maps that move together as a map asks change no signal, so they have no information."""
    m = np.eye(3)
    m.ravel()[k] += 1e-3  # all but n_z of itself, which the others and a scale make up
    theta, rig = mapped(case, point.theta, m)
    same, other = case.pixels.signals(point.theta, case.told), case.pixels.signals(theta, rig)
    lit = same[:, 0] > 0.02
    np.testing.assert_allclose(other[:, 0][lit], same[:, 0][lit], rtol=1e-3)
    free = posterior.basis.vectors.T @ (rig.vector - case.told.vector)
    own = theta - point.theta
    moves = np.concatenate([own, np.tile(posterior.vectors @ free, (len(theta), 1))], axis=1)
    weak = np.einsum("ni,ij,nj", own, weak_prior(own.shape[1] - 2)[1] / min(len(own), TIED), own)
    told = np.einsum("ni,nij,nj", moves, point.matrix, moves, optimize=True) - weak
    moves[:, : own.shape[1]] = 0
    assert told < 1e-3 * np.einsum("ni,nij,nj", moves, point.matrix, moves, optimize=True)


def test_pixels_that_would_lose_keep_their_maps(posterior, point):
    """At the new values of what is shared, as if all had been evaluated there."""
    free = point.free + 0.01
    moved = posterior.at(point.theta + 0.1, free)
    worse = moved.cost - point.cost > SLACK
    assert worse.any()
    worse[::2] = False
    found = posterior.kept(point, moved, worse)
    expected = posterior.at(np.where(worse[:, None], point.theta, point.theta + 0.1), free)
    for name in ("theta", "free", "cost", "gradient", "matrix", "residual", "variance"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    for name in ("value", "root", "across", "pull"):
        of = found.departures, expected.departures
        np.testing.assert_array_equal(*(getattr(departures, name) for departures in of), err_msg=name)


def test_pixels_that_can_not_move_hold_nothing_that_is_shared(posterior, point):
    """Damping is of their own steps only: however stuck they are, what is shared goes as far, and they follow."""
    damping = np.where(np.arange(len(point.theta)) % 2, 1e6, 0.0)
    step, response, rest, complement = posterior.solve(point)
    stuck = posterior.solve(point, damping)
    for free, damped in zip((step, response, complement), (stuck[0], stuck[1], stuck[3])):
        np.testing.assert_allclose(damped, free)
    np.testing.assert_allclose(stuck[2][::2], rest[::2])
    assert np.abs(stuck[2][1::2]).max() < 1e-4 * np.abs(rest).max() < np.abs(step).max()


def test_a_loss_counts_up_to_a_limit_and_only_of_pixels_that_are_heard(posterior, point):
    worse = replace(point, cost=point.cost + np.where(np.arange(len(point.cost)) == 3, 1000.0, 0.1))
    n = len(point.cost)
    assert posterior.risen(point, worse) == pytest.approx((MOST_COUNTED + 0.1 * (n - 1)) / n)
    deaf = replace(posterior, heard=np.arange(n) != 3)
    assert deaf.risen(point, worse) == pytest.approx(0.1)
    far = replace(point, free=point.free + posterior.sigma)
    assert posterior.risen(point, far) == pytest.approx(0.5 * len(point.free) / n)


def test_pixels_in_a_wrong_minimum_are_not_heard(posterior, point):
    theta = point.theta.copy()
    theta[5, 0] += 0.5
    learnt = posterior.learnt(posterior.at(theta, point.free))
    assert not learnt.heard[5] and learnt.heard.mean() > 0.9
    assert learnt.scatter == pytest.approx(0.02, rel=0.2)
    spoilt = posterior.at(theta, point.free)
    steps = [replace(posterior, heard=heard).solve(spoilt)[0] for heard in (learnt.heard, posterior.heard)]
    clean = replace(posterior, heard=learnt.heard).solve(posterior.at(point.theta, point.free))[0]
    np.testing.assert_allclose(steps[0], clean, atol=1e-9 + 1e-6 * np.abs(clean).max())
    assert np.abs(steps[1] - clean).max() > 10 * np.abs(steps[0] - clean).max()


@pytest.mark.parametrize("before", [0.01, 0.02, 0.3])
def test_scatter_falls_a_part_of_the_way_in_a_round(posterior, point, before):
    """Events that are far off for a small one pull no more, and what they would have moved stays where it is."""
    learnt = replace(posterior, scatter=before).learnt(point)
    assert learnt.scatter == pytest.approx(max(0.02, LEAST_LEFT * before), rel=0.2)


def test_a_rig_holds_what_is_not_free(case, posterior, point):
    rig = posterior.rig(point.free + 0.01)
    assert rig.refractory == case.told.refractory and np.any(rig.log_power) and rig.tilt.shape == (N_LED, 2)


@pytest.mark.parametrize("off", [0.002, 0.1, 2.0])
def test_how_well_powers_are_told_shows_in_how_far_they_are_off(case, posterior, point, off):
    """16 of them, and what is told counts as one more, up to a limit; directions, of which nothing is off, are told better."""
    powers = posterior.basis.owner == "powers"
    free = posterior.centre + np.where(powers, off * np.tile([1, -1], len(powers))[: len(powers)], 0)
    sigma = posterior.learnt_sigma(posterior.at(point.theta, free))
    expected = min(np.sqrt((16 * off**2 + Told().powers ** 2) / 17), 0.15)
    assert sigma[powers] == pytest.approx(expected, rel=0.3) and np.ptp(sigma[powers]) == 0
    assert sigma[~powers].max() < 0.5 * posterior.sigma[~powers].max()


@pytest.mark.parametrize(("left", "doubted"), [(0.4, True), (0.2, False)])
def test_powers_that_events_hardly_know_may_be_as_told(posterior, left, doubted):
    """Left open in tolerances; one of two values was taken, so that the other is as far as that."""
    powers = posterior.basis.owner == "powers"
    away = np.where(powers, 2.5 * posterior.told_sigma, 0.0)
    found = _doubted(posterior, np.diag(powers * (left * posterior.told_sigma) ** 2))
    assert found == (("powers",) if doubted else ())
    expected = np.outer(away, away) if doubted else np.zeros((len(away), len(away)))
    np.testing.assert_allclose(_between(posterior, away + ~powers, found), expected, rtol=1e-12)


def test_what_is_only_considered_makes_the_others_less_known(case):
    """The more the less is told of it; where nothing depends on it, not at all."""
    theta = case.solution.theta[case.row].astype(float)
    told = replace(case.told, tau=0.005, noise=0.01)
    start = Start(theta, told, np.ones(2), case.solution.noise)
    posterior = _posterior(case.pixels, start, told, Told(), ("refractory",))
    posterior = replace(posterior, stirred=("pole",))
    first = posterior.at(theta, posterior.basis.vectors.T @ told.vector)
    found = posterior.considered(first, Told(), "pole")
    assert found.shape == (1, 1) and found[0, 0] > 0
    assert posterior.considered(first, Told(pole=2.0), "pole") == pytest.approx(4 * found, rel=0.2)
    still = replace(posterior, stirred=())
    assert still.considered(still.at(theta, first.free), Told(), "pole") == pytest.approx(0, abs=1e-20)


def test_slopes_of_kinds_of_events_add_up(posterior, point):
    kind = np.arange(posterior.pixels.n_event) % 3
    again, slope = posterior.by_kind(point, kind)
    np.testing.assert_allclose(again.gradient, point.gradient, atol=1e-9 * np.abs(point.gradient).max())
    np.testing.assert_array_equal(again.matrix, point.matrix)
    assert slope.shape[:2] == (len(point.theta), 3) and np.abs(slope).max(axis=(0, 2)).min() > 0


@pytest.mark.parametrize(
    "tau_us, sigma_us, dimness, none",
    [
        (10.0, 2.0, 1.0, True),  # scatter of thresholds passes for noise of one that is quicker than any
        (30.0, 0.1, 1.0, False),
        (10.0, 3.0, 1.0, False),  # light is too slow to tell
        (1.0, 2.0, 0.1, False),  # in dim light the same number is a slower one
        (1.0, 0.2, 0.1, True),
    ],
)
def test_no_photoreceptor_is_as_quick_as_that(case, tau_us, sigma_us, dimness, none):
    start = Start(case.solution.theta[case.row].astype(float), case.told, np.ones(2), 0.02)
    light = SimpleNamespace(constant_light=[0.05 * dimness], band=case.pixels.light.band)
    pixels = replace(case.pixels, model=SimpleNamespace(illumination=light))  # slots of 10 ms
    posterior = replace(_posterior(case.pixels, start, case.told, Told(), ("tau",)), pixels=pixels)
    around = np.array([[(1e-4 * sigma_us) ** 2]])
    assert _no_lag(posterior, SimpleNamespace(free=np.array([1e-4 * tau_us])), around) == none
    without = _posterior(case.pixels, start, case.told, Told(), ("noise",))
    assert not _no_lag(without, SimpleNamespace(free=np.zeros(1)), around)


def test_the_spread_of_thresholds_is_that_of_most_pixels():
    """A third of them sit in a wrong minimum: far off, and as sure."""
    case = Case.sphere(size=16, thresholds=True, event_noise=0.02)
    theta = case.solution.all_theta[case.row].astype(float)
    theta[:, -2:] = 0.05 * np.random.default_rng(0).normal(size=(len(theta), 2))
    start = Start(theta, case.told, np.full(2, 0.05), case.solution.noise)
    posterior = _posterior(case.pixels, start, case.told, Told(), ("thresholds",))
    free = np.zeros(2)
    assert posterior.learnt(posterior.at(theta, free)).spread == pytest.approx(0.05, rel=0.25)
    theta[::3, -2:] = -9
    assert posterior.learnt(posterior.at(theta, free)).spread == pytest.approx(0.08, abs=0.03)
    theta[:, -2:] = np.random.default_rng(0).normal(size=(len(theta), 2))
    assert posterior.learnt(posterior.at(theta, free)).spread == pytest.approx(np.sqrt(LARGEST_VARIANCE))


def test_a_step_ends_at_bounds_and_the_others_go_with_it(case, rng):
    """As the best of all steps that end within them, by another solver."""
    told = replace(case.told, tau=0.0019, noise=0.0)
    theta = case.solution.theta[case.row].astype(float)
    start = Start(theta, told, np.ones(2), case.solution.noise)
    posterior = _posterior(case.pixels, start, told, Told(), ("tau", "noise", "shift", "thresholds"))
    free = posterior.basis.vectors.T @ told.vector
    n, least = len(free), np.where(np.isin(posterior.basis.owner, NOT_NEGATIVE), -free, -np.inf)
    least[posterior.basis.owner == "tau"] += QUICKEST_US / 10_000  # slots
    ended = 0
    for _ in range(20):
        half, best = rng.normal(size=(n, n)), rng.normal(size=n)

        def cost(step):
            return 0.5 * np.sum((half @ (step - best)) ** 2), half.T @ half @ (step - best)

        ends = posterior.within(free, best, half.T @ half)
        bounds = list(zip(least, np.full(n, np.inf)))
        found = minimize(
            cost, np.maximum(best, least), jac=True, bounds=bounds, options={"ftol": 0, "gtol": 1e-9}
        )
        ended += np.any(best < least)
        assert (ends >= least - 1e-12).all() and cost(ends)[0] <= cost(found.x)[0] + 1e-9
    assert 5 < ended < 20
