"""What a solve hands over."""

import numpy as np

from evsdr.solve.solution import Solution


def solution(**more):
    theta = np.arange(6.0).reshape(2, 3)
    return Solution(theta, np.zeros((2, 3, 3)), np.zeros(2), 0.1, np.ones(2), 5, **more)


def test_all_unknowns_hold_those_of_thresholds():
    assert solution().all_theta is solution().theta or (solution().all_theta == solution().theta).all()
    found = solution(threshold_gain=np.array([[1.0, 2.0], [3.0, 4.0]])).all_theta
    np.testing.assert_allclose(found[:, 3:], np.log([[1, 2], [3, 4]]))


def test_some_pixels_of_it():
    some = solution(threshold_gain=np.array([[1.0, 2.0], [3.0, 4.0]])).at(np.array([1]))
    assert some.theta.tolist() == [[3, 4, 5]] and some.threshold_gain.tolist() == [[3, 4]]
    assert some.covariance.shape == (1, 3, 3) and some.cost.shape == some.noise_factor.shape == (1,)


def test_reflectances_and_thresholds_move_alike():
    known = solution().moved(np.array([9.0, 9.0, 0.5]))
    assert known.theta.tolist() == [[0, 1, 2.5], [3, 4, 5.5]] and known.threshold_gain is None
    gain = np.array([[1.0, 2.0], [3.0, 4.0]])
    free = solution(threshold_gain=gain, threshold_prior=(0.1, 0.2, 0.3, 0.4))
    moved = free.moved(np.array([9, 9, 0.5, np.log(2), np.log(3)]))
    np.testing.assert_allclose(moved.all_theta - free.all_theta, [[0, 0, 0.5, np.log(2), np.log(3)]] * 2)
    np.testing.assert_allclose(moved.threshold_prior, [0.1 + np.log(2), 0.2 + np.log(3), 0.3, 0.4])
