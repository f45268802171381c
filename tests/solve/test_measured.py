"""What each LED gives a pixel by its own events, against the light that was recorded."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.events.pairs import pair_events
from evsdr.solve.loop import data_of
from evsdr.solve.measured import light_of, measure_signals
from evsdr.solve.problem import make_problem
from evsdr.solve.solution import Solution
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals
from tests.support.sphere import C_W, SPECTRUM, record_signal, ring_light

SIZE, ODD, NOISE = 14, 5, 0.1
FACTOR = 1.3  # of LED ODD, of which the maps know nothing


@pytest.fixture(scope="module")
def sphere():
    """Give the true signals of a sphere, the solver's data, and a solution that is the truth but for an LED."""
    normal, mask = sphere_normals(SIZE)
    signal = lambert_signals(normal, np.broadcast_to(SPECTRUM, (SIZE, SIZE, 8)), ring_directions())
    modelled = np.where(mask, signal, 0)
    real = modelled * np.where(np.arange(24) == ODD, FACTOR, 1)[:, None, None]
    recording = record_signal(real, threshold=0.1, event_noise=NOISE, n_round=8)
    problem = make_problem(recording, pair_events(recording), ring_light(), mask)
    light = problem.illumination
    data = data_of(problem.model, problem.pairs, light.constant_light, problem.grid, 10.0)
    n = normal[mask]
    theta = np.column_stack([-n[:, :2] / n[:, 2:], np.tile(np.log(SPECTRUM), (len(n), 1))]).astype(np.float32)
    ones = np.ones(len(n), np.float32)
    solution = Solution(theta, np.zeros((len(n), 10, 10)), ones, NOISE, ones, 0)
    return modelled[:, mask].T, real[:, mask].T, data, solution, problem.pixel


def test_modelled_light_is_that_of_the_maps(sphere):
    modelled, _, data, solution, pixel = sphere
    signals = measure_signals(data, solution, pixel)
    np.testing.assert_allclose(signals.modelled, modelled + C_W, rtol=2e-3, atol=1e-3)
    np.testing.assert_allclose(light_of(data, solution)[:, -1], C_W, rtol=1e-6)
    np.testing.assert_array_equal(signals.pixel, pixel)
    np.testing.assert_allclose(signals.direction, ring_directions(), atol=1e-6)
    assert signals.band.tolist() == [j % 8 for j in range(24)]
    assert signals.constant_light == pytest.approx(C_W)


def test_events_tell_of_an_led_that_the_maps_do_not_know(sphere):
    modelled, real, data, solution, pixel = sphere
    signals = measure_signals(data, solution, pixel)
    true = np.log((real + C_W) / (modelled + C_W))
    told = signals.count > 60
    assert np.count_nonzero(told) > 60
    bright = told & (modelled[:, ODD] > 5 * C_W)
    off = (signals.change - signals.change.mean(axis=1, keepdims=True)) - (
        true - true.mean(axis=1, keepdims=True)
    )
    assert np.median(signals.change[bright, ODD]) > 0.15 > 8 * np.median(np.abs(off[bright]))
    z = off[told] / signals.sigma[told]
    assert 0.7 < np.sqrt(np.mean(np.clip(z, -4, 4) ** 2)) < 1.4


def test_means_are_those_of_the_model(sphere):
    """Events tell only ratios: what is added to log light has mean 0 over all that is lit, darkness included."""
    *_, data, solution, pixel = sphere
    signals = measure_signals(data, solution, pixel)
    assert np.abs(signals.change.mean(axis=1)).max() < 1e-4  # no slot is dark, so darkness has no change


def test_residuals_show_what_maps_leave_unexplained(sphere):
    *_, data, solution, pixel = sphere
    signals = measure_signals(data, solution, pixel)
    busy = signals.count > 60
    assert 0.05 < np.median(signals.residual[busy]) < 0.4
    better = measure_signals(data, replace(solution, theta=solution.theta + np.float32(0.3)), pixel)
    assert np.median(better.residual[busy]) > 1.5 * np.median(signals.residual[busy])


def test_what_no_event_tells_is_unknown(sphere):
    *_, data, solution, pixel = sphere
    pairs = replace(data.pairs, last=data.pairs.first)
    signals = measure_signals(replace(data, pairs=pairs), solution, pixel)
    assert not signals.change.any() and not signals.residual.any()
    assert signals.sigma.min() > 0.95


def test_thresholds_that_were_found_count(sphere):
    """With thresholds half as large, the same events tell of half the changes."""
    *_, data, solution, pixel = sphere
    ones = np.ones((len(pixel), 2), np.float32)
    found = replace(solution, threshold_gain=ones, threshold_prior=(0.0, 0.0, 0.1, 0.1))
    one = measure_signals(data, found, pixel)
    half = measure_signals(data, replace(found, threshold_gain=0.5 * ones), pixel)
    busy = one.count > 60
    assert np.median(half.residual[busy]) > 2 * np.median(one.residual[busy])
