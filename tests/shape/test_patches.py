"""Vertices of pixels, against planes and parabolas with a formula."""

import numpy as np
import pytest

from evsdr.model.view import CameraGeometry
from evsdr.shape.patches import vertex_depth
from tests.support.depths import cut, joined, make_depth

HEIGHT, WIDTH = 6, 7
CAMERAS = [CameraGeometry(False, (0.1, 0.2), (3.0, 2.5)), CameraGeometry(True, (0.02, 0.03), (3.0, 2.5))]
SHIFT = 0.1, 0.2  # of the centre's vertex


def places(camera):
    """Image coordinates x and y of all vertices."""
    row, column = np.meshgrid((0, 0.5, 1), (0, 0.5, 1), indexing="ij")
    row, column = row.copy(), column.copy()
    row[1, 1], column[1, 1] = row[1, 1] + SHIFT[0], column[1, 1] + SHIFT[1]
    x = (np.arange(WIDTH)[:, None, None] + column - camera.center[0]) * camera.pixel_size[0]
    y = (camera.center[1] - np.arange(HEIGHT)[:, None, None, None] - row) * camera.pixel_size[1]
    return np.broadcast_arrays(x, y)


def plane(camera, normal, distance=5.0):
    """Depth of the plane normal . P = -distance, as a function of image coordinates."""
    if camera.perspective:
        return lambda x, y: -distance / (normal[0] * x + normal[1] * y - normal[2])
    return lambda x, y: (normal[0] * x + normal[1] * y + distance) / normal[2]


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("ties", ["all", "none", "some"])
def test_planes_are_met_exactly(camera, ties, rng):
    """Whatever is tied."""
    normal = np.array([0.4, -0.3, 0.8])
    surface = plane(camera, normal)
    centre = camera.points(np.ones((HEIGHT, WIDTH)))
    share = {"all": 1.0, "none": 0.0, "some": 0.6}[ties]
    tied = [t & (rng.random(t.shape) < share) for t in joined(np.ones((HEIGHT, WIDTH), bool))]
    depth = make_depth(surface(centre[..., 0], centre[..., 1]), camera, normal=normal, tied=tied)
    np.testing.assert_allclose(vertex_depth(depth, SHIFT), surface(*places(camera)), rtol=1e-12)


def test_parabolas_are_met_where_all_is_tied():
    """Off the border and the shifted centre."""
    camera = CAMERAS[0]

    def surface(x, y):
        return 5 + 0.5 * x**2 - 0.3 * y**2 + 0.2 * x * y

    x, y, _ = np.moveaxis(camera.points(np.ones((HEIGHT, WIDTH))), -1, 0)
    normal = np.stack([x + 0.2 * y, -0.6 * y + 0.2 * x, np.ones_like(x)], axis=-1)
    found = vertex_depth(make_depth(surface(x, y), camera, normal=normal), SHIFT)
    found, true = (
        v[1:-1, 1:-1].reshape(-1, 9)[:, [0, 1, 2, 3, 5, 6, 7, 8]] for v in (found, surface(*places(camera)))
    )
    np.testing.assert_allclose(found, true, rtol=1e-12)


@pytest.mark.parametrize("camera", CAMERAS)
def test_two_planes_meet_nowhere(camera):
    """Either side of a cut is its own plane, up to the cut and at its corners."""
    normals = [0.5, 0.2, 0.8], [-0.3, 0.1, 0.9]
    x, y, _ = np.moveaxis(camera.points(np.ones((HEIGHT, WIDTH))), -1, 0)
    left = np.broadcast_to(np.arange(WIDTH) < 3, (HEIGHT, WIDTH))
    near, far = plane(camera, normals[0], 3.0), plane(camera, normals[1], 7.0)
    depth = make_depth(
        np.where(left, near(x, y), far(x, y)), camera, normal=np.where(left[..., None], *normals)
    )
    found, side = vertex_depth(cut(depth, column=3), SHIFT), left[..., None, None]
    np.testing.assert_allclose(found, np.where(side, near(*places(camera)), far(*places(camera))), rtol=1e-12)
    joined_up = vertex_depth(depth, SHIFT)
    np.testing.assert_allclose(joined_up[:, 2, :, 2], joined_up[:, 3, :, 0])


def test_tied_neighbours_share_their_vertices(rng):
    """Around any pattern of cuts; a corner where a cut ends is shared by all four."""
    mask = np.ones((HEIGHT, WIDTH), bool)
    tied = [rng.random(t.shape) < 0.6 for t in joined(mask)]
    normal = rng.normal(size=(HEIGHT, WIDTH, 3)) * 0.2 + [0, 0, 1]
    found = vertex_depth(make_depth(5 + rng.random(mask.shape), CAMERAS[0], mask, normal, tied), SHIFT)
    below, beside = tied
    np.testing.assert_allclose(found[:-1, :, 2, :][below], found[1:, :, 0, :][below])
    np.testing.assert_allclose(found[:, :-1, :, 2][beside], found[:, 1:, :, 0][beside])
    apart = ~np.isclose(found[:, :-1, 1, 2], found[:, 1:, 1, 0])
    np.testing.assert_array_equal(apart, ~beside)
    ends_here = ~beside[:-1] & beside[1:] & below[:, :-1] & below[:, 1:]
    assert ends_here.any()
    np.testing.assert_allclose(found[:-1, :-1, 2, 2][ends_here], found[:-1, 1:, 2, 0][ends_here])


def test_inverse_depth_stays_positive():
    """Steep planes and large pixels under perspective."""
    camera = CameraGeometry(True, (0.5, 0.5), (3.5, 3.0))
    depth = make_depth(np.full((HEIGHT, WIDTH), 2.0), camera, normal=(0.9, 0.4, 0.1))
    for tied in (None, [np.zeros_like(t) for t in depth.tied]):
        found = vertex_depth(make_depth(depth.depth, camera, normal=(0.9, 0.4, 0.1), tied=tied), SHIFT)
        assert (found > 0.9).all() and (found < 8).all()
