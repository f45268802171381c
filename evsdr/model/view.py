"""The camera of a scene in plain numbers: which ray a pixel looks along, and where a point is seen."""

from dataclasses import dataclass

import numpy as np

MILLIMETRES = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0}  # in a unit that a scene may state


@dataclass(frozen=True)
class CameraGeometry:
    """Where the pixels look, in the camera frame: x right, y up, z toward the camera.

    Attributes
    ----------
    perspective : bool
        Else orthographic.
    pixel_size : (float, float)
        Width and height of a pixel [scene units]; with perspective at depth 1, the inverse of the focal
        length in pixels.
    center : (float, float)
        Column and row of the optical axis [pixels], from the upper left corner of the film.
    """

    perspective: bool
    pixel_size: tuple[float, float]
    center: tuple[float, float]

    def points(self, depth: np.ndarray) -> np.ndarray:
        """Give the surface points (H, W, 3) [scene units] of a depth map (H, W)."""
        height, width = depth.shape
        x = (np.arange(width) + 0.5 - self.center[0]) * self.pixel_size[0]
        y = (self.center[1] - np.arange(height) - 0.5) * self.pixel_size[1]
        xy = np.stack(np.meshgrid(x, y), axis=-1)
        if self.perspective:
            xy = depth[..., None] * xy
        return np.concatenate([xy, -depth[..., None]], axis=-1)


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


def depth_of_origin(view: View, center_z: float) -> float:
    """Give the distance [scene units] from the camera to a plane `center_z` before the world's origin."""
    return float(-view.point_to_camera(np.zeros(3))[2]) - center_z


def pixel_centers(mask: np.ndarray) -> np.ndarray:
    """Give the image points (n, 2) of the centres of a mask's pixels, row after row."""
    row, column = np.nonzero(mask)
    return np.stack([column + 0.5, row + 0.5], axis=1)
