"""The pose of a mesh in the camera's view."""

import numpy as np
import pytest
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from evsdr.calibration.pose import PoseEvidence, find_pose, read_model
from evsdr.errors import InputError
from evsdr.model.view import pixel_centers


def turned(model, turn: np.ndarray):
    """Turn a mesh about its middle, so that its file is no start."""
    from dataclasses import replace

    names = ("vertex", "normal", "face_normal")
    return replace(model, **{name: getattr(model, name) @ turn.T for name in names})


@pytest.mark.parametrize("with_normals, bound_deg", [(False, 1.0), (True, 0.15)])
def test_pose_from_a_silhouette(blob, with_normals, bound_deg):
    view, mask, truth, _, model = blob
    turn = Rotation.from_euler("xyz", [12, -15, 10], degrees=True).as_matrix()
    evidence = PoseEvidence(mask=mask, normal=truth.normal * truth.mask[..., None] if with_normals else None)
    found = find_pose(view, turned(model, turn), evidence, 10.0)
    error = np.degrees(Rotation.from_matrix(found.rotation @ turn).magnitude())
    assert error < bound_deg
    np.testing.assert_allclose(
        found.translation, view.point_to_camera(model.middle) * [1, 1, 0] - [0, 0, 10], atol=2e-3
    )
    assert np.std(found.outline_residual) < 0.5 and abs(found.outline_offset) < 0.3
    assert 0 < np.linalg.norm(found.rotation_sigma_deg) < bound_deg


def test_pose_of_a_box_from_its_silhouette(tmp_path, blob):
    """Few long edges, of which only those between light and dark faces make the outline."""
    import trimesh

    view = blob[0]
    trimesh.creation.box((0.8, 1.1, 0.5)).export(tmp_path / "box.ply")
    mesh, model = read_model(tmp_path / "box.ply", 1.0)
    turn = Rotation.from_euler("xyz", [25, 30, 10], degrees=True).as_matrix()
    hull = Delaunay(view.project(mesh.vertices @ turn.T + [0.1, 0.05, -10]))
    mask = hull.find_simplex(pixel_centers(np.ones((96, 96), bool))).reshape(96, 96) >= 0
    start = Rotation.from_euler("xyz", [4, -3, 5], degrees=True).as_matrix()
    found = find_pose(view, turned(model, start @ turn), PoseEvidence(mask=mask), 10.0)
    assert np.degrees(Rotation.from_matrix(found.rotation @ start).magnitude()) < 1.2
    np.testing.assert_allclose(found.translation, [0.1, 0.05, -10], atol=3e-3)
    assert abs(found.outline_offset) < 0.2


def test_pose_from_points_with_any_start(blob, points):
    view, _, _, _, model = blob
    pixel, point = points
    found = find_pose(view, model, PoseEvidence(pixel, point), 10.0)
    error = np.degrees(Rotation.from_matrix(found.rotation).as_rotvec())
    assert (np.abs(error) < 4 * found.rotation_sigma_deg).all()
    assert (found.rotation_sigma_deg < 0.6).all() and found.translation_sigma[2] == 0
    assert found.point_residual.max() < 1.5


def test_meshes_that_can_not_be_used_are_refused(tmp_path, blob):
    (tmp_path / "bad.obj").write_text("nothing\n")
    for name, says in (("none.ply", "no such file"), ("bad.obj", "not a mesh that trimesh reads")):
        with pytest.raises(InputError, match=says):
            read_model(tmp_path / name, 1.0)
    view, mask, _, _, model = blob
    for evidence, says in (
        (PoseEvidence(), "nothing tells the pose"),
        (PoseEvidence(mask=mask & False), "mask is empty"),
    ):
        with pytest.raises(InputError, match=says):
            find_pose(view, model, evidence, 10.0)
    with pytest.raises(InputError, match="border of the image"):
        find_pose(view, model, PoseEvidence(mask=mask | True), 10.0)


@pytest.mark.parametrize("name", ["nefertiti-lowres.obj", "skull_low_resolution.obj"])
def test_pose_of_a_downloaded_mesh(shared_data, blob, name):
    """A mesh of another program, of any size, from twelve exact points."""
    view = blob[0]
    mesh, raw = read_model(shared_data / "meshes" / name, 1.0)
    unit = 0.9 / raw.size
    mesh, model = read_model(shared_data / "meshes" / name, unit)
    turn = Rotation.from_euler("xyz", [40, 100, -30], degrees=True).as_matrix()
    rng = np.random.default_rng(2)
    point = mesh.vertices[rng.choice(len(mesh.vertices), 12)]
    placed = unit * (point - model.middle) @ turn.T + [0.05, -0.03, -10]
    found = find_pose(view, model, PoseEvidence(view.project(placed), point), 10.0)
    np.testing.assert_allclose(found.rotation, turn, atol=1e-5)
    np.testing.assert_allclose(found.translation[:2], [0.05, -0.03], atol=1e-5)
