"""Pixels and rays, there and back."""

import numpy as np
import pytest

from evsdr.model.view import CameraGeometry, View, depth_of_origin, pixel_centers

CAMERAS = [CameraGeometry(False, (0.1, 0.2), (6.5, 4.0)), CameraGeometry(True, (0.01, 0.02), (7.0, 3.5))]


@pytest.fixture
def turned(rng):
    """A rotation, and a place."""
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return frame * np.linalg.det(frame), np.array([1.0, -2.0, 3.0])


def view(camera, frame=None, origin=(0, 0, 0)):
    return View(camera, np.eye(3) if frame is None else frame, np.array(origin, float))


def test_points_by_hand():
    """Row 0 is the top; under perspective a point moves outward with its depth."""
    depth = np.full((8, 13), 2.0)
    flat, deep = (camera.points(depth) for camera in CAMERAS)
    np.testing.assert_allclose(flat[0, 0], [-0.6, 0.7, -2])
    np.testing.assert_allclose(flat[7, 12], [0.6, -0.7, -2])
    np.testing.assert_allclose(deep[0, 0], [2 * -0.065, 2 * 0.06, -2])


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_point_on_a_pixels_ray_is_seen_there(camera, rng):
    pixel, distance = rng.uniform(0, 12, (50, 2)), rng.uniform(1, 9, (50, 1))
    origin, direction = view(camera).rays(pixel)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1)
    assert (direction[:, 2] < 0).all()
    np.testing.assert_allclose(view(camera).project(origin + distance * direction), pixel, atol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
def test_points_of_a_depth_map_are_seen_in_their_pixels(camera, rng):
    depth = rng.uniform(1, 5, (8, 13))
    centers = pixel_centers(np.ones((8, 13), bool))
    np.testing.assert_allclose(view(camera).project(camera.points(depth).reshape(-1, 3)), centers, atol=1e-9)


def test_centers_of_a_mask_go_row_after_row():
    mask = np.array([[0, 1, 1], [1, 0, 0]], bool)
    np.testing.assert_array_equal(pixel_centers(mask), [[1.5, 0.5], [2.5, 0.5], [0.5, 1.5]])


def test_world_and_camera_frame(turned, rng):
    frame, origin = turned
    seen = view(CAMERAS[0], frame, origin)
    point = rng.normal(size=(4, 5, 3))
    np.testing.assert_allclose(seen.point_to_world(seen.point_to_camera(point)), point, atol=1e-12)
    np.testing.assert_allclose(seen.point_to_world(np.array([1.0, 0, 0])), origin + frame[0])
    np.testing.assert_allclose(seen.point_to_camera(origin + 2 * frame[2]), [0, 0, 2], atol=1e-12)


def test_depth_of_a_plane_before_the_origin():
    """The camera looks from z = 10 at the origin; a plane at z = 0.5 is 9.5 away."""
    assert depth_of_origin(view(CAMERAS[0], origin=(3, 0, 10)), 0.5) == pytest.approx(9.5)
