"""The solver of the depth against dense least squares."""

import numpy as np
import pytest

from evsdr.shape.laplacian import solve


def dense(weight, difference, shape):
    """Solve the same least squares without structure; the solution of least norm."""
    index = np.arange(np.prod(shape)).reshape(shape)
    rows, right = [], []
    for axis in (0, 1):
        i, j = np.delete(index, -1, axis), np.delete(index, 0, axis)
        for a, b, w, g in zip(i.ravel(), j.ravel(), weight[axis].ravel(), difference[axis].ravel()):
            row = np.zeros(index.size)
            row[a], row[b] = -np.sqrt(w), np.sqrt(w)
            rows.append(row)
            right.append(np.sqrt(w) * g)
    return np.linalg.lstsq(np.array(rows), np.array(right))[0].reshape(shape)


@pytest.mark.parametrize("shape", [(2, 2), (1, 7), (7, 1), (5, 8), (9, 6)])
def test_solver_against_dense(shape, rng):
    """Weights over six decades, some of them zero."""
    shapes = ((shape[0] - 1, shape[1]), (shape[0], shape[1] - 1))
    weight = [10 ** rng.uniform(-3, 3, s) for s in shapes]
    difference = [rng.normal(size=s) for s in shapes]
    if shape == (9, 6):
        weight[0][4] = 0  # two components
    value = solve(weight, difference, np.zeros(shape), 1e-9)
    expected = dense(weight, difference, shape)
    for axis in (0, 1):
        joined = weight[axis] > 0
        step = np.diff(value, axis=axis)[joined]
        np.testing.assert_allclose(step, np.diff(expected, axis=axis)[joined], atol=1e-5)


def test_solver_starts_warm(rng):
    """What is solved already stays as it is, whatever its offset."""
    value = rng.normal(size=(20, 30))
    difference = [np.diff(value, axis=axis) for axis in (0, 1)]
    weight = [np.ones_like(d) for d in difference]
    np.testing.assert_allclose(solve(weight, difference, value + 3, 0.01), value + 3, atol=1e-12)
