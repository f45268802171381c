"""Read a camera from Mitsuba."""

import mitsuba as mi
import numpy as np

from evsdr.integrators.ring import camera_frame
from evsdr.light.scene import RingScene
from evsdr.model.arrays import columns
from evsdr.model.view import CameraGeometry, View


def view_of(ring) -> View:
    """Read the camera of a loaded scene.

    Parameters
    ----------
    ring : scene.RingScene
        The scene.
    """
    frame = camera_frame(ring.sensor)
    matrix = np.array(ring.sensor.world_transform().matrix, float).reshape(4, 4)
    origin = matrix[:3, 3]
    perspective = ring.sensor.class_name() == "PerspectiveCamera"
    corner = np.array([_look(ring.sensor, at, frame, origin, perspective) for at in ((0, 0), (1, 0), (0, 1))])
    width = (corner[1, 0] - corner[0, 0]) / ring.width
    height = (corner[0, 1] - corner[2, 1]) / ring.height
    center = (float(-corner[0, 0] / width), float(corner[0, 1] / height))
    return View(CameraGeometry(perspective, (float(width), float(height)), center), frame, origin)


def _look(sensor, at: tuple[float, float], frame, origin, perspective: bool) -> np.ndarray:
    """Give x and y, camera frame, where the ray of a film point starts; at depth 1 with perspective."""
    ray, _ = sensor.sample_ray(0.0, 0.5, list(map(float, at)), [0.5, 0.5])
    if perspective:
        d = frame @ np.array(ray.d, float).ravel()
        return d[:2] / -d[2]
    return (frame @ (np.array(ray.o, float).ravel() - origin))[:2]


def view_directions(ring: RingScene, pixel: np.ndarray) -> mi.Vector3f | None:
    """Give unit vectors from the surface to a perspective camera, camera frame; None if it is orthographic."""
    geometry, _ = camera_geometry(ring.sensor)
    if not geometry.perspective:
        return None
    points = geometry.points(np.ones((ring.height, ring.width))).reshape(-1, 3)[pixel]
    return mi.Vector3f(*columns(mi.Float, -points / np.linalg.norm(points, axis=1, keepdims=True)))


def camera_geometry(sensor: mi.Sensor) -> tuple[CameraGeometry, np.ndarray]:
    """Give where the pixels look, and the transformation (4, 4) from the camera frame to the world."""
    ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f([0, 1], [0, 1]), mi.Point2f(0.5))  # corners of the film
    frame, to_world = camera_frame(sensor), np.eye(4)
    to_world[:3, :3] = frame.T
    to_world[:3, 3] = np.array(sensor.world_transform().matrix, float).reshape(4, 4)[:3, 3]
    perspective = sensor.class_name() == "PerspectiveCamera"
    if perspective:
        direction = frame @ np.array(ray.d, float)
        x, y = direction[:2] / -direction[2]
    else:
        x, y = (frame @ (np.array(ray.o, float) - to_world[:3, 3:]))[:2]
    width, height = (int(n) for n in sensor.film().crop_size())
    size = float(x[1] - x[0]) / width, float(y[0] - y[1]) / height
    return CameraGeometry(perspective, size, (-float(x[0]) / size[0], float(y[0]) / size[1])), to_world
