"""Photoreceptors that lag, and maps, in turns."""

from types import SimpleNamespace

import numpy as np
import pytest

from evsdr import EventPixel, angular_error_deg, fit, load_scene, simulate
from evsdr.effects.world import Terms
from evsdr.fitting import following
from evsdr.records import Schedule

ORDER = np.array([led for j in range(24) for led in ((-1, j) if j % 3 == 0 else (j,))], np.int32)


@pytest.fixture(scope="module")
def dim():
    """A sphere before an EVK4: slots of 2 ms, in whose dark ones it lags by as much as they last."""
    ring = load_scene("scenes/sphere.xml", size="16")
    given = EventPixel(), Schedule(ORDER, 2000.0, crossfade=1.0)
    recording, truth = simulate(ring, *given, seed=1, thresholds="nominal")
    return fit(ring, recording), truth


@pytest.mark.slow
def test_maps_are_right_where_photoreceptors_lag_by_a_slot(dim):
    """With pairs that do not say how they answer to other light: 0.6 degrees, and reflectances 12 to 16 % too low."""
    found, truth = dim
    known = truth.mask & found.maps.mask
    error = angular_error_deg(found.maps.normal, truth.normal)[known]
    assert known.sum() > 0.95 * truth.mask.sum() and error.mean() < 0.5
    assert np.mean(error <= 3 * found.maps.normal_sigma_deg[known]) > 0.97
    ratio = found.maps.reflectance[known] / truth.reflectance[known]
    assert np.median(ratio) == pytest.approx(1, abs=0.06)


def test_nothing_moves_without_a_lag():
    assert following.moves(SimpleNamespace(lag=None), None) == 0


@pytest.mark.parametrize(
    ("moved", "thorough", "turns"),
    [
        ((0.05,), True, 0),
        ((0.5, 0.2, 0.05), True, 2),
        ((0.5, 0.2, 0.05), False, 1),
        ((0.3, 0.2, 0.2, 0.05), True, 2),  # a few pixels go to and fro
        ((0.3, 0.2, 0.19, 0.05), True, 2),
        (tuple(0.8**k for k in range(20)), False, 6),
        (tuple(0.89**k for k in range(20)), True, 8),
    ],
)
def test_fits_follow_until_residuals_are_still(monkeypatch, moved, thorough, turns):
    left = iter(moved)
    monkeypatch.setattr(following, "moves", lambda world, fitted: next(left))
    terms = Terms(thorough=thorough)
    world = SimpleNamespace(problem=lambda fitted: fitted, terms=terms)

    def solve(problem, before, purpose, progress):
        assert purpose == "again" and problem is before
        return before + 1

    assert following.follow(world, 0, solve, lambda *_: False) == turns


def test_who_stops_gets_the_best_so_far(monkeypatch):
    monkeypatch.setattr(following, "moves", lambda *_: 1.0)
    world = SimpleNamespace(terms=Terms())
    assert following.follow(world, 7, None, lambda *_: True) == 7
