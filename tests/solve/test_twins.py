import numpy as np

from evsdr.solve.twins import Twins, second_of


def test_reflectance_tells_of_two_normals_that_explain_as_much():
    """Most pixels have the level 0 in one of their explanations; where one explains less, that is not it."""
    rng = np.random.default_rng(0)
    right = np.arange(60) % 2
    level = rng.normal(0, 0.05, (2, 60))
    level[1 - right, np.arange(60)] -= rng.uniform(0.5, 2.5, 60)
    cost = np.zeros((2, 60))
    cost[0, 0], level[:, 0], right[0] = 50, (0, -2), 1
    told = np.arange(60) < 50
    level[:, ~told] = -1.5
    chosen = second_of(cost, level, told)
    np.testing.assert_array_equal(chosen[told], right[told] == 1)
    assert not chosen[~told].any()
    assert not second_of(cost, level, np.zeros(60, bool)).any()


def test_matt_surfaces_have_none():
    data = type("Data", (), {"model": None})
    state = object()
    assert Twins(3, 0.1)(data, state) is state
