"""Cameras of Mitsuba in plain numbers: their rays are those of the sensor itself."""

import mitsuba as mi
import numpy as np
import pytest

from evsdr.light.camera import camera_geometry, view_directions, view_of
from evsdr.light.scene import load_scene
from evsdr.model.view import pixel_centers
from tests.support.small_scene import HEIGHT, WIDTH, camera, scene

OFF_AXIS = """<float name="fov" value="40"/><float name="principal_point_offset_x" value="0.1"/>
    <float name="principal_point_offset_y" value="-0.2"/>"""


@pytest.fixture(params=["orthographic", "perspective", "off axis"])
def ring(request, tmp_path):
    """A camera that stands askew."""
    text = camera(kind="perspective" if request.param == "off axis" else request.param)
    text = text.replace('<float name="fov" value="40"/>', OFF_AXIS) if request.param == "off axis" else text
    text = text.replace("0, 0, 4", "1, 2, 4").replace("0, 1, 0", "0.3, 1, 0.1")
    (tmp_path / "scene.xml").write_text(scene(sensor=text))
    return load_scene(tmp_path / "scene.xml")


def sensor_rays(ring):
    """Origins and directions (n, 3) of the pixels' centres, in the world, as Mitsuba gives them."""
    at = pixel_centers(np.ones((HEIGHT, WIDTH), bool)) / [WIDTH, HEIGHT]
    ray, _ = ring.sensor.sample_ray(0.0, 0.5, mi.Point2f(at.T.astype(np.float32)), mi.Point2f(0.5))
    return np.array(ray.o, float).T, np.array(ray.d, float).T


def test_points_of_the_sensors_rays_are_seen_in_their_pixels(ring):
    origin, direction = sensor_rays(ring)
    view = view_of(ring)
    pixel = view.project(view.point_to_camera(origin + 3 * direction))
    np.testing.assert_allclose(pixel, pixel_centers(np.ones((HEIGHT, WIDTH), bool)), atol=2e-3)
    size = view.camera.pixel_size
    assert size[0] == pytest.approx(size[1], rel=1e-4) and min(size) > 0


def test_view_and_geometry_are_of_one_camera(ring):
    view, (geometry, to_world) = view_of(ring), camera_geometry(ring.sensor)
    assert geometry.perspective == view.camera.perspective
    assert geometry.pixel_size == pytest.approx(view.camera.pixel_size)
    assert geometry.center == pytest.approx(view.camera.center, abs=1e-3)
    np.testing.assert_allclose(to_world[:3, :3], view.frame.T, atol=1e-6)
    np.testing.assert_allclose(to_world[:3, 3], view.origin, atol=1e-6)
    toward = np.array([1.0, 2, 4]) / np.sqrt(21)
    np.testing.assert_allclose(view.frame[2], toward, atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(view.frame), 1, atol=1e-6)


def test_directions_to_the_camera(ring):
    some = np.array([0, 5, WIDTH * HEIGHT - 1])
    directions = view_directions(ring, some)
    if ring.sensor.class_name() == "OrthographicCamera":
        assert directions is None
    else:
        _, to_world = camera_geometry(ring.sensor)
        expected = -sensor_rays(ring)[1][some] @ to_world[:3, :3]
        np.testing.assert_allclose(np.array(directions, float).T, expected, atol=1e-4)
