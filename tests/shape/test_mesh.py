"""Meshes of depth maps, and their PLY files as trimesh reads them."""

import numpy as np
import pytest
import trimesh

from evsdr.errors import InputError
from evsdr.model.view import CameraGeometry
from evsdr.shape.depth import integrate_normals
from evsdr.shape.mesh import make_mesh, write_mesh
from tests.support.depths import cut, make_depth

CAMERA = CameraGeometry(False, (0.1, 0.1), (6.0, 5.0))


def depth_map(depth, mask=None, camera=CAMERA):
    return make_depth(depth, camera, mask)


def frontal(shape):
    return np.broadcast_to([0.0, 0, 1], (*shape, 3))


def face_normals(mesh):
    corner = mesh.position[mesh.face]
    return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])


@pytest.mark.parametrize("perspective", [False, True])
def test_triangles_face_the_camera(perspective, rng):
    """Each quad makes two triangles that cover it, whichever way it is cut."""
    camera = CameraGeometry(perspective, (0.1, 0.1), (6.0, 5.0))
    mesh = make_mesh(depth_map(4 + 0.05 * rng.random((10, 12)), camera=camera), frontal((10, 12)))
    assert mesh.face.shape == (2 * 9 * 11, 3) and mesh.position.shape == (120, 3)
    cross, center = face_normals(mesh), mesh.position[mesh.face].mean(axis=1)
    toward = -center if perspective else np.array([0, 0, 1.0])
    assert (np.sum(cross * toward, axis=-1) > 0).all()
    if not perspective:
        np.testing.assert_allclose(cross[:, 2], 0.01)  # twice the area, seen from the camera
        assert len(np.unique(np.sort(mesh.face, axis=1), axis=0)) == len(mesh.face)


def test_shorter_diagonal():
    """Along an oblique step each quad keeps a triangle that lies on one side, either way it runs."""
    row, column = np.mgrid[:10, :12]
    for deep in (row > column, row + column > 9):
        mesh = make_mesh(depth_map(np.where(deep, 4.0, 3.0)), frontal((10, 12)))
        flat = np.ptp(mesh.position[mesh.face][..., 2], axis=1) == 0
        n_deep = sum(deep[i : i + 9, j : j + 11].astype(int) for i in (0, 1) for j in (0, 1))
        assert flat.sum() == np.sum(np.array([2, 1, 0, 1, 2])[n_deep])
        assert 0 < np.sum(n_deep % 2) and len(mesh.face) == 2 * 9 * 11


def test_quads_with_a_hole():
    """Of four pixels any three make a triangle, two make none."""
    for hole in ((0, 0), (0, 1), (1, 0), (1, 1)):
        mask = np.ones((2, 2), bool)
        mask[hole] = False
        mesh = make_mesh(depth_map(np.full((2, 2), 3.0), mask), frontal((2, 2)))
        assert sorted(mesh.face[0]) == [0, 1, 2] and len(mesh.face) == 1
        assert face_normals(mesh)[0, 2] > 0
    assert len(make_mesh(depth_map(np.full((2, 2), 3.0), np.eye(2, dtype=bool)), frontal((2, 2))).face) == 0


def test_no_triangle_spans_a_jump():
    """Neither along a column, nor along a staircase, whose quads keep the triangles of either side."""
    depth = np.where(np.arange(12) < 6, 4.0, 3.0) * np.ones((10, 1))
    whole, apart = (
        make_mesh(d, frontal((10, 12))) for d in (depth_map(depth), cut(depth_map(depth), column=6))
    )
    assert len(apart.face) == 2 * 9 * 10 and len(whole.face) == 2 * 9 * 11
    assert np.ptp(apart.position[apart.face][..., 2], axis=1).max() == 0
    row, column = np.mgrid[:10, :12]
    for deep in (row > column, row + column > 9):
        tied = [np.diff(deep, axis=axis) == 0 for axis in (0, 1)]
        mesh = make_mesh(make_depth(np.where(deep, 4.0, 3.0), CAMERA, tied=tied), frontal((10, 12)))
        n_deep = sum(deep[i : i + 9, j : j + 11].astype(int) for i in (0, 1) for j in (0, 1))
        assert len(mesh.face) == np.sum(np.array([2, 1, 0, 1, 2])[n_deep])
        assert np.ptp(mesh.position[mesh.face][..., 2], axis=1).max() == 0


def test_where_a_cut_ends_one_triangle_goes():
    """Of four pixels in a ring, three ties hold: two triangles need both sides of a corner."""
    for axis, place in ((0, (0, 0)), (0, (0, 1)), (1, (0, 0)), (1, (1, 0))):
        tied = [np.ones((1, 2), bool), np.ones((2, 1), bool)]
        tied[axis][place] = False
        assert len(make_mesh(make_depth(np.ones((2, 2)), CAMERA, tied=tied), frontal((2, 2))).face) == 1


def test_world(rng):
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = rotation, [1, 2, 3]
    depth, normal = depth_map(4 + 0.1 * rng.random((10, 12))), np.full((10, 12, 3), [0.0, 0.6, 0.8])
    camera, world = make_mesh(depth, normal), make_mesh(depth, normal, to_world=to_world)
    np.testing.assert_allclose(camera.position, depth.points.reshape(-1, 3))
    np.testing.assert_allclose(world.position, [rotation @ p + [1, 2, 3] for p in camera.position])
    np.testing.assert_allclose(world.normal, np.tile(rotation @ [0, 0.6, 0.8], (120, 1)))
    np.testing.assert_array_equal(camera.face, world.face)


def test_ply(tmp_path, rng):
    """Given normals and colours come back, not those of the triangles."""
    mask = rng.random((10, 12)) > 0.2
    normal = rng.normal(size=(10, 12, 3)) + [0, 0, 4]
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    colour = rng.random((10, 12, 3))
    mesh = make_mesh(depth_map(4 + 0.05 * rng.random((10, 12)), mask), normal, colour)
    write_mesh(tmp_path / "mesh.ply", mesh)
    read = trimesh.load(tmp_path / "mesh.ply", process=False)
    np.testing.assert_allclose(read.vertices, mesh.position, atol=1e-6)
    np.testing.assert_allclose(read.vertex_normals, normal[mask], atol=1e-6)
    np.testing.assert_array_equal(read.visual.vertex_colors[:, :3], np.round(255 * colour[mask]))
    np.testing.assert_array_equal(read.faces, mesh.face)
    assert [file.name for file in tmp_path.iterdir()] == ["mesh.ply"]


def test_ply_without_colours(tmp_path):
    write_mesh(
        tmp_path / "mesh.ply", make_mesh(depth_map(np.full((3, 3), 2.0)), np.full((3, 3, 3), [0, 0.6, 0.8]))
    )
    read = trimesh.load(tmp_path / "mesh.ply", process=False)
    np.testing.assert_allclose(read.vertex_normals, np.tile([0, 0.6, 0.8], (9, 1)), atol=1e-6)
    assert b"red" not in (tmp_path / "mesh.ply").read_bytes()[:500]
    with pytest.raises(InputError, match="cannot be written"):
        write_mesh(tmp_path / "missing" / "mesh.ply", make_mesh(depth_map(np.ones((3, 3))), frontal((3, 3))))


def test_one_pixel(tmp_path):
    depth = integrate_normals(frontal((4, 4)), np.eye(4) * [0, 1, 0, 0], CAMERA, anchor=3.0)
    mesh = make_mesh(depth, frontal((4, 4)), np.ones((4, 4, 3)))
    assert len(mesh.face) == 0 and len(mesh.position) == 1
    write_mesh(tmp_path / "mesh.ply", mesh)
    assert (tmp_path / "mesh.ply").stat().st_size > 100


def test_bad_input():
    depth = depth_map(np.ones((3, 4)))
    with pytest.raises(InputError, match="normal has shape"):
        make_mesh(depth, frontal((4, 3)))
    with pytest.raises(InputError, match="colour has shape"):
        make_mesh(depth, frontal((3, 4)), np.ones((3, 4)))
    with pytest.raises(InputError, match="to_world has shape"):
        make_mesh(depth, frontal((3, 4)), to_world=np.eye(3))
