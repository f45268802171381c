"""What each pixel sees of each LED otherwise than its model says, beside what all of them share."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.solve.shared.departures import FIRST, LEAST, eliminated
from evsdr.solve.shared.infer import _posterior
from evsdr.solve.shared.posterior import Start
from evsdr.solve.shared.rig import Told
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals
from tests.support.shared_unknowns import N_LED, Case
from tests.support.sphere import SPECTRUM, record_signal, ring_light

SPREAD = 0.05
NAMES = "powers", "refractory", "thresholds"


def recorded(spread, seed=0, size=20):
    """Record a sphere each pixel of which sees each LED brighter or darker, as chance has it, than a matt one would."""
    normal, mask = sphere_normals(size)
    signal = lambert_signals(normal, np.broadcast_to(SPECTRUM, (size, size, 8)), ring_directions())
    seen = np.exp(np.random.default_rng(seed).normal(0, spread, signal.shape))
    recording = record_signal(np.where(mask, signal * seen, 0), event_noise=0.02, seed=seed)
    return Case(recording, ring_light(), normal, mask)


@pytest.fixture(scope="module")
def odd():
    return recorded(SPREAD)


def quadratic(rng, n_pixel=3, n=4, n_led=5, m=7):
    """Give sums of a cost that is quadratic in maps, departures and what is shared, and that cost."""
    size = n + m
    root = rng.normal(size=(n_pixel, size, size + 2))
    matrix = root @ root.transpose(0, 2, 1)
    gradient, value = rng.normal(size=(n_pixel, size)), rng.normal(0, 0.1, (n_pixel, n_led))
    return value, np.zeros(n_pixel), gradient, matrix


def test_an_event_that_outweighs_all_others_leaves_a_minimum(rng):
    """What is left stays positive definite, where two LEDs share an event 1e10 times as telling as the rest."""
    value, cost, gradient, matrix = quadratic(rng)
    n, sigma = 4, 0.1
    row = np.zeros((len(matrix), 11))
    row[:, [0, 2, n, n + 1]] = 3e5 * np.array([0.1, 0.01, 1, -1 + 1e-6])
    sharp = matrix * 1e-2 + row[:, :, None] * row[:, None]
    _, _, left, _ = eliminated(value, sigma, n, cost, gradient, sharp)
    assert np.linalg.eigvalsh(left[:, :n, :n]).min() > 0


def test_what_is_left_is_that_of_the_best_departures(rng):
    """Cost, gradient and matrix after they are eliminated, by minimising over them."""
    value, cost, gradient, matrix = quadratic(rng)
    n, n_led, sigma = 4, value.shape[1], 0.3
    led = np.arange(n, n + n_led)
    got_cost, got_gradient, got_matrix, departures = eliminated(value, sigma, n, cost, gradient, matrix)

    def best(x, move):
        """Give the least cost of pixel x where all else moved, and the departures there."""
        own = matrix[x][np.ix_(led, led)] + np.eye(n_led) / sigma**2
        pull = gradient[x, led] + matrix[x][led] @ move + value[x] / sigma**2
        step = -np.linalg.solve(own, pull)
        all_of_it = move.copy()
        all_of_it[led] += step
        least = gradient[x] @ all_of_it + 0.5 * all_of_it @ matrix[x] @ all_of_it
        return least + 0.5 * np.sum((value[x] + step) ** 2) / sigma**2, value[x] + step

    for x in range(len(value)):
        for move in (np.zeros(gradient.shape[1]), rng.normal(size=gradient.shape[1])):
            least, where = best(x, move)
            told = got_cost[x] + got_gradient[x] @ move + 0.5 * move @ got_matrix[x] @ move
            assert told == pytest.approx(least, rel=1e-9)
            # `after` takes one move of what is shared for all pixels
            after = departures.after(np.tile(move[:n], (len(value), 1)), move[n:])[x]
            np.testing.assert_allclose(after, np.clip(where, -1, 1), atol=1e-9)


def test_slopes_of_kinds_are_those_with_departures_that_follow(rng):
    value, cost, gradient, matrix = quadratic(rng)
    n, led = 4, np.arange(4, 4 + value.shape[1])
    departures = eliminated(value, 0.3, n, cost, gradient, matrix)[-1]
    slope, move = rng.normal(size=(len(value), 2, gradient.shape[1])), rng.normal(size=gradient.shape[1])
    got = departures.followed(slope, n) @ move
    for x in range(len(value)):
        own = matrix[x][np.ix_(led, led)] + np.eye(len(led)) / 0.3**2
        with_them = move.copy()
        with_them[led] -= np.linalg.solve(own, matrix[x][led] @ move)
        np.testing.assert_allclose(got[x], slope[x] @ with_them)


def test_the_gradient_is_that_of_the_cost_with_the_best_departures(odd):
    """By finite differences, once departures are the best for these maps."""
    theta = odd.solution.theta[odd.row].astype(float)
    start = Start(theta, odd.told, np.ones(2), odd.solution.noise, departs=SPREAD)
    posterior = _posterior(odd.pixels, start, odd.told, Told(), NAMES)

    def settled(free):
        point, value = posterior.at(theta, free, some), np.zeros((len(theta), odd.pixels.light.n_led))
        for _ in range(30):
            value[some] = point.departures.after(
                np.zeros_like(theta[some]), np.zeros(posterior.vectors.shape[0])
            )
            point = posterior.at(theta, free, some, value)
        return point

    free, some = posterior.basis.vectors.T @ odd.told.vector, np.arange(0, len(theta), 5)
    here = settled(free)
    slope = here.gradient[:, theta.shape[1] :] @ posterior.vectors
    for k in (0, 5, 11):
        step = 1e-4 * np.eye(len(free))[k]
        after, before = (settled(free + s * step).cost for s in (1, -1))
        off = np.abs(slope[:, k] - (after - before) / 2e-4)
        assert np.quantile(off, 0.9) < 0.05 * np.std(
            slope[:, k]
        )  # in others the search for them goes to and fro


@pytest.mark.parametrize("spread", [0.0, 0.02, SPREAD, 0.08])
def test_how_widely_pixels_depart_is_learnt(spread):
    """And powers, which are told right, are found as well as that lets them."""
    case = recorded(spread, seed=1)
    found = case.infer(NAMES)
    assert found.departs == pytest.approx(spread, rel=0.2, abs=0.006)
    off = found.rig.log_power / found.sigma.log_power
    assert np.sqrt(np.mean(off**2)) < 1.7
    assert np.mean(found.sigma.log_power) > 0.6 * spread / np.sqrt(len(case.row))


def test_left_out_they_pass_for_what_is_shared(odd):
    """The twin: taken for none, what is told is known worse, and believed better."""
    theta = odd.solution.theta[odd.row].astype(float)
    start = Start(theta, odd.told, np.ones(2), odd.solution.noise, departs=LEAST)
    frozen = _posterior(odd.pixels, start, odd.told, Told(), NAMES)
    free = frozen.basis.vectors.T @ odd.told.vector
    known = {}
    for departs in (LEAST, SPREAD):
        posterior = replace(frozen, departs=departs)
        point = posterior.at(theta, free)
        known[departs] = np.sqrt(
            np.diag(np.linalg.inv(posterior.solve(point)[3]))[posterior.basis.owner == "powers"]
        )
    assert np.median(known[SPREAD] / known[LEAST]) > 2
    assert FIRST < SPREAD and N_LED == 24
