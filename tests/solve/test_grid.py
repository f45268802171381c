import mitsuba as mi
import numpy as np
import pytest

from evsdr.solve import grid as g
from evsdr.solve.grid import beside, make_grid, nearest
from tests.support.stencil_matrix import MASK, matrix_of


def test_neighbours_are_the_adjacent_masked_pixels():
    index = make_grid(np.array([[1, 1, 0], [0, 1, 1]], bool), mi.UInt32).links.index
    np.testing.assert_array_equal(index["right"], [1, 1, 3, 3])
    np.testing.assert_array_equal(index["left"], [0, 0, 2, 2])
    np.testing.assert_array_equal(index["up"], [0, 1, 1, 3])
    np.testing.assert_array_equal(index["down"], [0, 2, 2, 3])
    np.testing.assert_array_equal(index["down_right"], [2, 3, 2, 3])


def test_pixels_some_steps_away():
    mask = np.array([[1, 1, 1], [0, 1, 0], [1, 0, 1]], bool)
    assert beside(mask, "right").tolist() == [1, 2, -1, -1, -1, -1]
    assert beside(mask, "right", 2).tolist() == [2, -1, -1, -1, 5, -1]
    assert beside(mask, "up_left", 2).tolist() == [-1, -1, -1, -1, -1, 0]
    assert beside(mask, "down", 3).tolist() == [-1] * 6


@pytest.mark.parametrize("name", ["SECOND_X", "SECOND_Y", "AROUND_P", "AROUND_Q", "SQUARE_MEAN"])
def test_stencils_are_their_matrices(name, rng):
    stencil, links = getattr(g, name), make_grid(MASK, mi.UInt32).links
    matrix = matrix_of(stencil)
    assert np.abs(matrix).sum() > 0
    value = rng.normal(size=MASK.sum()).astype(np.float32)
    np.testing.assert_allclose(stencil.apply(links, mi.Float(value)), matrix @ value, atol=1e-5)
    back = np.where(stencil.valid(links).numpy(), value, 0).astype(np.float32)
    np.testing.assert_allclose(stencil.adjoint(links, mi.Float(back)), matrix.T @ back, atol=1e-5)
    np.testing.assert_allclose(
        stencil.times(stencil).apply(links, mi.Float(value)), matrix**2 @ value, atol=1e-5
    )


def test_slopes_of_a_surface_add_up_to_nothing():
    """z = x y (x right, y up): its slopes p = y, q = x go round a square without gain; those of no surface don't."""
    rows, columns = np.mgrid[:5, :6].astype(np.float32)
    links = make_grid(np.ones((5, 6), bool), mi.UInt32).links

    def around(p, q):
        p, q = mi.Float(p.ravel()), mi.Float(q.ravel())
        return g.AROUND_P.apply(links, p).numpy() + g.AROUND_Q.apply(links, q).numpy()

    np.testing.assert_allclose(around(-rows, columns), 0, atol=1e-5)
    turning = around(rows, columns).reshape(5, 6)[:-1, :-1]
    np.testing.assert_allclose(turning, -2, atol=1e-5)


def test_the_nearest_good_pixel_by_brute_force(rng):
    mask = rng.random((9, 11)) < 0.7
    good = rng.random(mask.sum()) < 0.2
    place = np.argwhere(mask)
    apart = np.linalg.norm(place[:, None] - place[None, good], axis=-1)
    found = nearest(good, mask)
    assert good[found].all()
    np.testing.assert_allclose(np.linalg.norm(place - place[found], axis=1), apart.min(axis=1))
