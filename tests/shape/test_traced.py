"""The mesh that light is traced on: it lies on the surface and covers whole pixels."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from evsdr.model.view import CameraGeometry
from evsdr.records import Maps
from evsdr.shape.traced import depth_of, masked_mesh, surface_files, traced_mesh
from tests.support.depths import cut, make_depth

HEIGHT, WIDTH = 9, 12
CAMERAS = [CameraGeometry(False, (0.1, 0.1), (6.0, 4.5)), CameraGeometry(True, (0.02, 0.02), (5.0, 4.0))]


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


def seen(position, face, camera, column, row):
    """Depths at which the line of sight of an image point meets the triangles."""
    corner = position[face]
    scale = -corner[..., 2] if camera.perspective else 1.0
    x = corner[..., 0] / scale / camera.pixel_size[0] + camera.center[0] - column
    y = camera.center[1] - corner[..., 1] / scale / camera.pixel_size[1] - row
    area = np.stack([np.roll(x, -1, 1) * np.roll(y, -2, 1) - np.roll(x, -2, 1) * np.roll(y, -1, 1)], axis=0)[
        0
    ]
    total = area.sum(axis=1)
    inside = (np.abs(total) > 1e-12) & ((area >= 0).all(axis=1) | (area <= 0).all(axis=1))
    weight = area[inside] / total[inside, None]
    depth = -corner[inside][..., 2]
    return 1 / np.sum(weight / depth, axis=1) if camera.perspective else np.sum(weight * depth, axis=1)


@pytest.mark.parametrize("camera", CAMERAS)
def test_every_line_of_sight_meets_the_surface_once(camera, rng):
    """Wherever it runs in a pixel, whatever is tied: a plane's depth, and a roof's."""
    normal = np.array([0.3, 0.2, 0.9])
    place = camera.points(np.ones((HEIGHT, WIDTH)))
    if camera.perspective:
        depth = 5 / -(place @ normal)
    else:
        depth = 5 + (place[..., :2] @ normal[:2]) / normal[2]
    surface = make_depth(depth, camera, normal=normal)
    for mesh in (traced_mesh(surface, np.eye(4)), traced_mesh(cut(surface, column=4), np.eye(4))):
        for column, row in rng.random((50, 2)) * [WIDTH, HEIGHT]:
            x = (column - camera.center[0]) * camera.pixel_size[0]
            y = (camera.center[1] - row) * camera.pixel_size[1]
            if camera.perspective:
                true = -5 / (normal @ [x, y, -1])
            else:
                true = 5 + (normal[0] * x + normal[1] * y) / normal[2]
            np.testing.assert_allclose(seen(*mesh, camera, column, row), [true], rtol=1e-9)


def test_the_mesh_covers_a_lonely_pixel():
    """Whole, facing the camera, and nothing beside it."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[4, 6] = True
    position, face = traced_mesh(make_depth(np.full(mask.shape, 5.0), CAMERAS[0], mask), np.eye(4))
    center = CAMERAS[0].points(np.full(mask.shape, 5.0))[4, 6]
    corner = position[face].reshape(-1, 3)
    np.testing.assert_allclose(corner.min(axis=0), center - [0.05, 0.05, 0], atol=1e-12)
    np.testing.assert_allclose(corner.max(axis=0), center + [0.05, 0.05, 0], atol=1e-12)
    cross = np.cross(position[face[:, 1]] - position[face[:, 0]], position[face[:, 2]] - position[face[:, 0]])
    assert (cross[:, 2] > 0).all() and cross[:, 2].sum() / 2 == pytest.approx(0.01)


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_jump_has_a_wall_along_the_lines_of_sight(camera):
    """Left half at 3, right half at 5: nothing between the depths but the wall, which no camera sees."""
    near = np.broadcast_to(np.arange(WIDTH) < 6, (HEIGHT, WIDTH))
    surface = make_depth(np.where(near, 3.0, 5.0), camera)
    position, face = traced_mesh(cut(surface, column=6), np.eye(4))
    depth = -position[:, 2]
    assert np.isin(np.round(depth, 9), (3, 5)).all()
    wall = face[np.ptp(depth[face], axis=1) > 1]
    scale = depth if camera.perspective else 1.0
    column = position[:, 0] / scale / camera.pixel_size[0] + camera.center[0]
    np.testing.assert_allclose(column[wall], 6)
    height = position[wall][..., 1]
    assert len(wall) == 4 * HEIGHT and np.ptp(height) == pytest.approx(
        HEIGHT * camera.pixel_size[1] * (5 if camera.perspective else 1)
    )
    joined, _ = traced_mesh(surface, np.eye(4))
    assert not np.isin(np.round(-joined[:, 2], 9), (3, 5)).all()


def test_the_faces_are_those_of_the_mask():
    """Cuts move vertices alone, as the mesh is made once and moved."""
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[3, 4:7] = False
    surface = make_depth(np.full(mask.shape, 5.0), CAMERAS[0], mask)
    (one, face), (other, same) = (traced_mesh(d, np.eye(4)) for d in (surface, cut(surface, column=5)))
    np.testing.assert_array_equal(face, same)
    assert one.shape == other.shape == (9 * mask.sum(), 3)


def test_the_mesh_stands_in_the_world(rng):
    to_world = np.eye(4)
    to_world[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    to_world[:3, 3] = [1, 2, 3]
    depth = make_depth(5 + 0.1 * rng.random((HEIGHT, WIDTH)), CAMERAS[0])
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


def test_silent_background_does_not_move_what_is_known():
    """Where no mask bounds the object, known pixels lie on average where the scene says; a piece without any does as a whole."""
    mask, anchor = np.ones((HEIGHT, WIDTH), bool), np.full((HEIGHT, WIDTH), 7.0)
    mask[:, 1] = False
    known = mask & (np.arange(WIDTH) > WIDTH // 2)
    tilted = replace(make_maps(mask), mask=known, normal=np.broadcast_to([0.3, 0, 1.0], (*mask.shape, 3)))
    whole, part = (depth_of(tilted, mask, CAMERAS[0], anchor, bounded).depth for bounded in (True, False))
    right = mask & (np.arange(WIDTH) > 1)
    assert whole[right].mean() == pytest.approx(7) and abs(whole[known].mean() - 7) > 0.05
    assert part[known].mean() == pytest.approx(7) and part[:, 0].mean() == pytest.approx(7)


def test_only_known_pixels_are_shown(tmp_path):
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[:, 6] = False
    depth = make_depth(np.full(mask.shape, 5.0), CAMERAS[0])
    mesh = masked_mesh(depth, make_maps(mask), np.eye(4))
    assert len(mesh.position) == mask.sum() and len(mesh.face) == 2 * (HEIGHT - 1) * (WIDTH - 3)
    assert len(np.unique(mesh.colour, axis=0)) == 1
    for name, write in surface_files(depth, make_maps(mask), np.eye(4)).items():
        write(tmp_path / name)
    assert {path.name for path in tmp_path.iterdir()} == {"depth.exr", "mesh.ply"}
    assert len(trimesh.load(tmp_path / "mesh.ply", process=False).vertices) == mask.sum()
