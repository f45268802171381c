"""Derivatives of the small solver, and its equations."""

import numpy as np

from evsdr.preview import kernels
from tests.support.preview_ball import ball_light

THETA = np.array([0.3, -0.2, -1.0, -0.4, -0.9, -1.3])
ORDER = np.array([0, 5, -1, 3, 7, 2, 11])
SLOT, FADE = (
    np.array([[0, 0], [1, 3], [6, 0], [2, 2]]),
    np.array([[0.1, 0.6], [0.2, 0.5], [0.3, 0.0], [0.0, 0.9]]),
)
CHANGE = np.array([0.2, -0.3, 0.25, 0.1])


def signals(theta):
    light, out = ball_light(), np.empty((12, 3))
    kernels.led_signals(theta, light.vector[0], light.band, 0.1, out)
    return out


def cost(theta):
    return kernels.misfit(SLOT, FADE, CHANGE, ORDER, 0.05, signals(theta), theta)


def test_the_right_side_is_the_slope_of_the_misfit():
    matrix, right = np.empty((6, 6)), np.empty(6)
    band = ball_light().band
    value = kernels.equations(SLOT, FADE, CHANGE, ORDER, band, 0.05, signals(THETA), THETA, matrix, right)
    assert np.isclose(value, cost(THETA))
    step = 1e-5 * np.eye(6)
    slope = [(cost(THETA + h) - cost(THETA - h)) / 2e-5 for h in step]
    np.testing.assert_allclose(-2 * right, slope, rtol=1e-4, atol=1e-8)


def test_damped_equations(rng):
    root = rng.normal(size=(6, 6))
    matrix, right, step = root @ root.T, rng.normal(size=6), np.empty(6)
    kernels.solve_damped(matrix, right, 0.5, np.empty((6, 6)), step)
    damped = matrix + np.diag(0.5 * np.diag(matrix))
    np.testing.assert_allclose(damped @ step, right, atol=1e-6)
    np.testing.assert_allclose(matrix, root @ root.T)


def test_pairs_lie_in_slots_also_before_the_round_starts():
    slot, fade, change = np.empty((2, 2), np.int64), np.empty((2, 2)), np.empty(2)
    told = np.array([1, 0, 1], np.int8), np.array([-30, 15, 48]), 0.2, 0.3, 10.0, (0.0, 10.0), 4, 0.5
    kernels.list_pairs(*told, slot, fade, change)
    np.testing.assert_array_equal(slot, [[2, 1], [2, 0]])
    np.testing.assert_allclose(fade, [[0, 0], [0, 0.6]], atol=1e-12)
    np.testing.assert_array_equal(change, [-0.3, 0.2])
