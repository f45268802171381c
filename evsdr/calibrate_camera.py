"""The camera of a scene in plain numbers: which ray a pixel looks along, and where a point is seen."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.console import parse_definitions
from evsdr.depth import CameraGeometry


@dataclass(frozen=True)
class View:
    """A camera and where it stands.

    Attributes
    ----------
    camera : CameraGeometry
        Its pixels.
    frame : (3, 3) float
        Axes of the camera frame in the world, as rows: right, up, toward the camera.
    origin : (3,) float
        Its place in the world.
    """

    camera: CameraGeometry
    frame: np.ndarray
    origin: np.ndarray

    def rays(self, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Give origins and unit directions (n, 3), camera frame, of image points (n, 2).

        Image points are (column, row) [pixels] from the upper left corner of the film.
        """
        size, center = self.camera.pixel_size, self.camera.center
        x = (pixel[:, 0] - center[0]) * size[0]
        y = (center[1] - pixel[:, 1]) * size[1]
        zero, one = np.zeros_like(x), np.ones_like(x)
        if not self.camera.perspective:
            return np.stack([x, y, zero], axis=1), np.stack([zero, zero, -one], axis=1)
        d = np.stack([x, y, -one], axis=1)
        return np.zeros_like(d), d / np.linalg.norm(d, axis=1, keepdims=True)

    def project(self, point: np.ndarray) -> np.ndarray:
        """Give the image points (n, 2) at which points (n, 3) of the camera frame are seen."""
        xy = point[:, :2] / -point[:, 2:] if self.camera.perspective else point[:, :2]
        size, center = self.camera.pixel_size, self.camera.center
        return np.stack([center[0] + xy[:, 0] / size[0], center[1] - xy[:, 1] / size[1]], axis=1)

    def point_to_camera(self, point: np.ndarray) -> np.ndarray:
        """Bring points (..., 3) of the world into the camera frame."""
        return (point - self.origin) @ self.frame.T

    def point_to_world(self, point: np.ndarray) -> np.ndarray:
        """Bring points (..., 3) of the camera frame into the world."""
        return point @ self.frame + self.origin


def view_of(ring) -> View:
    """Read the camera of a loaded scene.

    Parameters
    ----------
    ring : scene.RingScene
        The scene.
    """
    from evsdr.integrators.ring import camera_frame

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


def load_ring(scene: Path, define: tuple[str, ...]):
    """Load a scene.xml with `name=value` parameters; gives a scene.RingScene."""
    from evsdr import jit

    jit.start()
    from evsdr.scene import load_scene

    return load_scene(scene, parse_definitions(define))


def depth_of_origin(view: View, center_z: float) -> float:
    """Give the distance [scene units] from the camera to a plane `center_z` before the world's origin."""
    return float(-view.point_to_camera(np.zeros(3))[2]) - center_z


def pixel_centers(mask: np.ndarray) -> np.ndarray:
    """Give the image points (n, 2) of the centres of a mask's pixels, row after row."""
    row, column = np.nonzero(mask)
    return np.stack([column + 0.5, row + 0.5], axis=1)
