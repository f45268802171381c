"""The mesh that light is traced on: it lies on the surface and covers whole pixels."""

import numpy as np
import pytest
import trimesh

from evsdr.model.view import CameraGeometry
from evsdr.records import Maps
from evsdr.shape.depth import Depth
from evsdr.shape.traced import _refined, depth_of, masked_mesh, surface_files, traced_mesh

HEIGHT, WIDTH = 9, 12
CAMERAS = [CameraGeometry(False, (0.1, 0.1), (6.0, 4.5)), CameraGeometry(True, (0.02, 0.02), (5.0, 4.0))]


def make_depth(depth, mask=None, camera=CAMERAS[0], component=None):
    mask = np.ones(depth.shape, bool) if mask is None else mask
    component = mask.astype(np.int32) if component is None else component
    return Depth(np.where(mask, depth, 0), mask, component, camera)


def make_maps(mask, normal=(0.0, 0, 1)):
    shape = mask.shape
    return Maps(
        np.broadcast_to(np.float32(normal), (*shape, 3)),
        np.full((*shape, 3), 0.5, np.float32),
        mask,
        np.where(mask, 1.0, 180.0).astype(np.float32),
        np.ones((*shape, 3), np.float32),
        np.float32([450, 550, 650]),
    )


@pytest.mark.parametrize("axis", [0, 1])
def test_refining_keeps_cubics(axis, rng):
    """Both new samples after each inner one lie on the polynomial."""
    polynomial = np.polynomial.Polynomial(rng.normal(size=4))
    value = np.repeat(polynomial(np.arange(8.0))[:, None], 3, axis=1)
    found = np.moveaxis(_refined(value if axis == 0 else value.T, axis, 0.02), axis, 0)
    at = 1.02 + 0.5 * np.arange(10)
    np.testing.assert_allclose(found, np.repeat(polynomial(at)[:, None], 3, axis=1), rtol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_smooth_surface_lies_on_its_mesh(camera):
    """Away from the border, where depth is extended, cubic interpolation of a parabola is exact."""
    column, row = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))

    def surface(column, row):
        return 5 + 0.02 * (column - 4) ** 2 + 0.01 * (row - 3) ** 2

    position, _ = traced_mesh(make_depth(surface(column, row), camera=camera), np.eye(4))
    depth = -position[:, 2]
    scale = depth if camera.perspective else 1.0
    column = position[:, 0] / scale / camera.pixel_size[0] + camera.center[0] - 0.5
    row = camera.center[1] - position[:, 1] / scale / camera.pixel_size[1] - 0.5
    inner = (column > 1) & (column < WIDTH - 2) & (row > 1) & (row < HEIGHT - 2)
    assert inner.sum() > 100
    np.testing.assert_allclose(depth[inner], surface(column, row)[inner], rtol=1e-9)


def test_the_mesh_reaches_a_pixel_beyond_the_mask():
    """A lonely pixel lies on it whole, and it faces the camera."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[4, 6] = True
    position, face = traced_mesh(make_depth(np.full(mask.shape, 5.0), mask), np.eye(4))
    center = CAMERAS[0].points(np.full(mask.shape, 5.0))[4, 6]
    low, high = position[face].reshape(-1, 3).min(axis=0), position[face].reshape(-1, 3).max(axis=0)
    assert (low[:2] < center[:2] - 0.05).all() and (high[:2] > center[:2] + 0.05).all()
    assert (high[:2] - low[:2] < 0.35).all()
    cross = np.cross(position[face[:, 1]] - position[face[:, 0]], position[face[:, 2]] - position[face[:, 0]])
    assert (cross[:, 2] > 0).all()
    np.testing.assert_allclose(position[:, 2], -5)


def test_pieces_stay_apart():
    """Left half at 3, right half at 5, as two components: no triangle joins them."""
    near = np.broadcast_to(np.arange(WIDTH) < 6, (HEIGHT, WIDTH))
    component = np.where(near, 1, 2).astype(np.int32)
    joined, apart = (
        traced_mesh(make_depth(np.where(near, 3.0, 5.0), component=c), np.eye(4)) for c in (None, component)
    )
    assert np.ptp(joined[0][joined[1]][..., 2], axis=1).max() > 1
    assert len(apart[1]) < len(joined[1])
    side = apart[0][:, 0] / 0.1 + 6 - 0.5 > 5.5
    assert (np.ptp(side[apart[1]].astype(int), axis=1) == 0).all()


def test_a_gap_takes_the_farther_depth():
    """A nearer one would cast a shadow."""
    near = np.broadcast_to(np.arange(WIDTH) < 6, (HEIGHT, WIDTH))
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[:, 5] = False
    position, _ = traced_mesh(make_depth(np.where(near, 3.0, 5.0), mask), np.eye(4))
    column = position[:, 0] / 0.1 + 6 - 0.5
    gap = np.abs(column - 5) < 0.1
    assert gap.any() and (-position[gap, 2] > 4.5).all()


def test_the_mesh_stands_in_the_world(rng):
    to_world = np.eye(4)
    to_world[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    to_world[:3, 3] = [1, 2, 3]
    depth = make_depth(5 + 0.1 * rng.random((HEIGHT, WIDTH)))
    (camera, face), (world, same) = (traced_mesh(depth, matrix) for matrix in (np.eye(4), to_world))
    np.testing.assert_allclose(world, camera @ to_world[:3, :3].T + [1, 2, 3])
    np.testing.assert_array_equal(face, same)


def test_pieces_take_the_scenes_depth_where_it_is_seen():
    """An anchor that is known in a corner alone counts for all."""
    mask = np.ones((HEIGHT, WIDTH), bool)
    anchor = np.zeros(mask.shape)
    anchor[:2, :2] = 7.0
    assert depth_of(make_maps(mask), mask, CAMERAS[0], anchor).depth == pytest.approx(
        np.full(mask.shape, 7.0)
    )
    free = depth_of(make_maps(mask), mask, CAMERAS[0], np.zeros(mask.shape))
    assert free.depth == pytest.approx(np.zeros(mask.shape))


def test_only_known_pixels_are_shown(tmp_path):
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[:, 6] = False
    depth = make_depth(np.full(mask.shape, 5.0))
    mesh = masked_mesh(depth, make_maps(mask), np.eye(4))
    assert len(mesh.position) == mask.sum() and len(mesh.face) == 2 * (HEIGHT - 1) * (WIDTH - 3)
    assert len(np.unique(mesh.colour, axis=0)) == 1
    for name, write in surface_files(depth, make_maps(mask), np.eye(4)).items():
        write(tmp_path / name)
    assert {path.name for path in tmp_path.iterdir()} == {"depth.exr", "mesh.ply"}
    assert len(trimesh.load(tmp_path / "mesh.ply", process=False).vertices) == mask.sum()
