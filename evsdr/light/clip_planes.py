"""Clip planes of a camera: Mitsuba's own, 0.01 and 10000, must not cut scenes in small or large units."""

import mitsuba as mi
import numpy as np

NEAR, FAR = 1e-2, 1e4  # Mitsuba's, where a scene file tells none
ROOM = 2.0  # by which the far one is behind all there is
RATIO = 1e-3  # of the near one to the farthest point at most; guessed: float32 keeps the directions of rays


def open_clip_planes(sensor: mi.Sensor, box: mi.BoundingBox3f) -> None:
    """Move the clip planes of a camera so that nothing of a scene is cut; those that its file tells stay.

    Parameters
    ----------
    sensor : mi.Sensor
        Changed in place.
    box : mi.BoundingBox3f
        Of the scene.
    """
    planes = mi.traverse(sensor)
    near, far = planes["near_clip"], planes["far_clip"]
    matrix = np.array(sensor.world_transform().matrix, float).reshape(4, 4)
    corners = np.stack(np.meshgrid(*np.array([box.min, box.max], float).reshape(2, 3).T), -1).reshape(-1, 3)
    if not np.allclose((near, far), (NEAR, FAR)) or not np.isfinite(corners).all():
        return
    depth = (corners - matrix[:3, 3]) @ matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    farthest = float(depth.max())
    if farthest <= 0 or (depth.min() >= near and farthest <= far):
        return
    planes["near_clip"] = min(near, RATIO * farthest)
    planes["far_clip"] = max(far, ROOM * farthest)
    planes.update()
