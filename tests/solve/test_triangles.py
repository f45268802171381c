import mitsuba as mi
import numpy as np
import pytest

from evsdr.solve import triangles

N, N_PIXEL = 7, 50


@pytest.fixture
def matrix(rng):
    """Random symmetric matrices (N_PIXEL, N, N)."""
    root = rng.normal(size=(N_PIXEL, N, N))
    return root @ np.swapaxes(root, 1, 2) + 0.5 * np.eye(N)


def triangle(matrix):
    rows, columns = np.tril_indices(matrix.shape[-1])
    return [mi.Float(matrix[:, i, j].astype(np.float32)) for i, j in zip(rows, columns)]


def vectors(values):
    return [mi.Float(v.astype(np.float32)) for v in values.T]


def numbers(arrays):
    return np.array([v.numpy() for v in arrays]).T


def test_damped_systems_are_solved(matrix, rng):
    right, damping = rng.normal(size=(N_PIXEL, N)), 0.3
    x = triangles.solve(*triangles.factor(triangle(matrix), mi.Float(damping)), vectors(right))
    expected = np.linalg.solve(matrix + damping * matrix * np.eye(N), right[..., None])[..., 0]
    np.testing.assert_allclose(numbers(x), expected, rtol=5e-3, atol=5e-3)


def test_the_inverse_is_the_inverse(matrix):
    inverse = numbers(triangles.invert(*triangles.factor(triangle(matrix))))
    rows, columns = np.tril_indices(N)
    np.testing.assert_allclose(inverse, np.linalg.inv(matrix)[:, rows, columns], rtol=2e-2, atol=5e-3)


def test_pixels_that_few_events_tell_all_of_have_finite_inverses(rng):
    """Two directions that noise-free events tell to 1e-4, and ten that only weak priors tell: rounding is more than these."""
    n, weak = 12, 0.1
    root = rng.normal(size=(1000, n, 2)) * 10 ** rng.uniform(0, 4, (1000, 1, 2))
    inverse = numbers(
        triangles.invert(*triangles.factor(triangle(root @ np.swapaxes(root, 1, 2) + weak * np.eye(n))))
    )
    assert np.isfinite(inverse).all() and np.abs(inverse).max() < 1e6 / weak


def test_the_product_is_the_product(matrix, rng):
    x = rng.normal(size=(N_PIXEL, N))
    product = numbers(triangles.multiply(triangle(matrix), vectors(x)))
    np.testing.assert_allclose(product, np.einsum("xij,xj->xi", matrix, x), rtol=1e-4, atol=1e-4)


def test_coloured_noise_has_the_matrix_as_covariance(matrix):
    """Columns of a root: colouring the unit vectors gives a matrix whose square is M."""
    lower, pivot = triangles.factor(triangle(matrix))
    root = np.stack(
        [numbers(triangles.color(lower, pivot, vectors(np.eye(N)[[k] * N_PIXEL]))) for k in range(N)], -1
    )
    np.testing.assert_allclose(root @ np.swapaxes(root, 1, 2), matrix, rtol=1e-4, atol=1e-3)


def test_what_rounding_made_singular_has_an_inverse(matrix):
    matrix = matrix.copy()
    steep = np.r_[1e6, 1e6, np.zeros(N - 3), 2.0]
    matrix[3] = np.outer(steep, steep) + np.diag(np.r_[0, 0, np.ones(N - 2)])
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.inv(matrix)
    found, others = triangles.inverse_of(matrix), np.arange(N_PIXEL) != 3
    np.testing.assert_array_equal(found[others], np.linalg.inv(matrix[others]))
    assert np.isfinite(found).all() and (np.diagonal(found[3]) > 0).all()
    np.testing.assert_allclose(np.diagonal(found[3])[2:-1], 1, rtol=1e-3)  # what is told apart stays so
