"""A ball under the ring, for tests of calibrations: camera, LEDs off their places, images over pixels."""

import numpy as np

from evsdr.events.pixel import EventPixel
from evsdr.model.view import CameraGeometry, View
from tests.support.analytic import ring_directions

SIZE, EXTENT, LIGHT = 32, 1.15, 0.05


OUTLINE = np.array([SIZE / 2, SIZE / 2, SIZE / 2 / EXTENT])


PIXEL = EventPixel().idealised()


def camera(size: int = SIZE, perspective: bool = False) -> View:
    """Look from z = 10 at a film of the analytic sphere's extent."""
    width = 2 * EXTENT / size / (10 if perspective else 1)
    geometry = CameraGeometry(perspective, (width, width), (size / 2, size / 2))
    return View(geometry, np.eye(3), np.array([0.0, 0.0, 10.0]))


def moved_directions(rng) -> np.ndarray:
    """Give LEDs that lie a few degrees off the nominal ring."""
    direction = ring_directions() + rng.normal(0, 0.06, (24, 3))
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


def average(signal: np.ndarray, factor: int) -> np.ndarray:
    """Average images (n, H, W) over blocks of pixels."""
    n, height, width = signal.shape
    return signal.reshape(n, height // factor, factor, width // factor, factor).mean(axis=(2, 4))
