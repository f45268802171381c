"""A workspace of COLMAP: opened by COLMAP itself where it is installed, and by a reader of its documented formats."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from evsdr.errors import InputError
from evsdr.exports.colmap import PICTURE, write_colmap
from evsdr.exports.source import read_source
from evsdr.model.view import CameraGeometry

CAMERA = CameraGeometry(True, (0.01, 0.0125), (12.5, 9.0))
TO_WORLD = np.eye(4)
TO_WORLD[:3, :3] = Rotation.from_euler("xyz", (30, -50, 110), degrees=True).as_matrix()
TO_WORLD[:3, 3] = 7.0, -40.0, 20.0


@pytest.fixture(scope="module")
def source(results):
    """The fit, seen by a perspective camera that stands somewhere."""
    orthographic = read_source(results)
    depth = np.where(orthographic.maps.mask, -orthographic.points[..., 2], 0)
    return replace(orthographic, camera=CAMERA, to_world=TO_WORLD, points=CAMERA.points(depth))


@pytest.fixture(scope="module")
def workspace(source, tmp_path_factory):
    folder = tmp_path_factory.mktemp("colmap")
    write_colmap(folder, source)
    return folder


def read_array(path):
    """Read an array as COLMAP's `read_write_dense.py` does: its size in text, then columns, rows, channels."""
    *size, data = path.read_bytes().split(b"&", 3)
    return np.frombuffer(data, "<f4").reshape([int(n) for n in size], order="F").transpose(1, 0, 2)


def test_maps_are_those_of_the_fit(workspace, source):
    mask = source.maps.mask
    for kind in ("geometric", "photometric"):
        depth = read_array(workspace / "stereo" / "depth_maps" / f"{PICTURE}.{kind}.bin")[..., 0]
        normal = read_array(workspace / "stereo" / "normal_maps" / f"{PICTURE}.{kind}.bin")
        np.testing.assert_allclose(depth, -source.points[..., 2], rtol=1e-6)
        np.testing.assert_allclose(normal[mask], source.maps.normal[mask] * [1, -1, -1], rtol=1e-6)
        assert not depth[~mask].any() and not normal[~mask].any()


def test_the_model_projects_its_points_onto_their_pixels(workspace, source):
    """By the equations of COLMAP's documentation: x = R X + t, pixel = f x / z + c."""
    width, height, *pinhole = map(float, (workspace / "sparse/cameras.txt").read_text().split()[2:])
    pose, seen = (workspace / "sparse/images.txt").read_text().splitlines()
    told = [float(word) for word in pose.split()[1:8]]
    points = np.loadtxt(workspace / "sparse/points3D.txt")
    world = points[:, 1:4] @ Rotation.from_quat(np.roll(told[:4], -1)).as_matrix().T + told[4:]
    at = np.array(seen.split(), float).reshape(-1, 3)
    np.testing.assert_allclose(world[:, :2] / world[:, 2:] * pinhole[:2] + pinhole[2:], at[:, :2], atol=1e-6)
    np.testing.assert_allclose(world[:, 2], -source.points[source.maps.mask][:, 2])
    np.testing.assert_array_equal(at[:, 2], points[:, 0])
    assert (height, width) == source.maps.mask.shape


def test_colmap_opens_and_fuses_it(workspace, source, tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction(workspace / "sparse")
    assert (model.num_images(), len(model.points3D)) == (1, np.count_nonzero(source.maps.mask))
    assert model.compute_mean_reprojection_error() < 1e-6
    options = pycolmap.StereoFusionOptions(min_num_pixels=1, num_threads=1)
    fused = pycolmap.stereo_fusion(tmp_path, workspace, options=options)
    found = np.array([point.xyz for point in fused.points3D.values()])
    corner = replace(CAMERA, center=(13.0, 9.5))  # its fusion takes a pixel's corner for its centre
    points = corner.points(-source.points[..., 2])[source.maps.mask]
    away, nearest = cKDTree(found).query(points @ TO_WORLD[:3, :3].T + TO_WORLD[:3, 3])
    assert away.max() < 1e-3 and len(np.unique(nearest)) == len(points) == len(found)


def test_an_orthographic_camera_is_refused(results, tmp_path):
    with pytest.raises(InputError, match="orthographic, and COLMAP knows perspective cameras only; take"):
        write_colmap(tmp_path, read_source(results))
    assert not any(tmp_path.iterdir())
