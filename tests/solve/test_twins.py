import numpy as np
import pytest

from evsdr.metrics import angular_error_deg
from evsdr.solve.twins import Both, Twins, second_of
from evsdr.solve.unknowns import normal_sigma_deg, to_normal


def test_reflectance_tells_of_two_normals_that_explain_as_much():
    """Most pixels have the level 0 in one of their explanations, whatever events prefer that are not explained quite."""
    rng = np.random.default_rng(0)
    right = np.arange(60) % 2
    level = rng.normal(0, 0.05, (2, 60))
    level[1 - right, np.arange(60)] -= rng.uniform(0.5, 2.5, 60)
    cost = np.zeros((2, 60))
    cost[0, 1], level[:, 1] = 50, (0, -2)
    told = np.arange(60) < 50
    level[:, ~told] = -1.5
    right[1] = 0
    chosen = second_of(cost, level, told)
    np.testing.assert_array_equal(chosen[told], right[told] == 1)
    assert not chosen[~told].any()
    assert not second_of(cost, level, np.zeros(60, bool)).any()


def test_sigma_holds_the_twin_where_reflectance_and_events_disagree():
    maps = np.zeros((2, 40, 3))
    maps[1, :, 0], maps[1, :, 2] = 0.8, np.linspace(2, 4, 40)
    cost = np.zeros((2, 40))
    cost[0, 0] = 50.0
    both = Both((), (), maps, cost, np.ones(40, bool))
    error = both.left_open(np.ones(40))
    angle = angular_error_deg(*map(to_normal, maps))[0]
    sigma = normal_sigma_deg(maps[0, :, 0], maps[0, :, 1], error[:, :2, :2])
    assert sigma[0] == pytest.approx(angle, rel=0.01) and np.sqrt(error[0, 2, 2]) == pytest.approx(
        2, rel=0.01
    )
    assert not error[1:].any()
    assert 0 < both.left_open(np.full(40, 2.5))[0, 2, 2] < 3.9  # events that are explained badly tell less


def test_matt_surfaces_have_none():
    data = type("Data", (), {"model": None})
    state = object()
    assert Twins(3, 0.1)(data, state) is state
