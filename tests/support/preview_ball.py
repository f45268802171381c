"""The ball of `watched_files` as the preview sees it: its light, its normals, and a recording."""

from functools import cache

import numpy as np

from evsdr.preview.decoder import Light
from evsdr.records import Recording
from tests.support.watched_files import CONSTANT_LIGHT, N_LED, PIXEL, SIZE, recorded


def ball_normal() -> np.ndarray:
    """Give the normals (height, width, 3), up in y, 0 beside the ball and at its rim."""
    x, y = np.meshgrid(np.linspace(-1.1, 1.1, SIZE), np.linspace(1.1, -1.1, SIZE))
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    return np.stack([x, y, z], -1) * (z > 0.3)[..., None]


def ball_light() -> Light:
    azimuth = 2 * np.pi * np.arange(N_LED) / N_LED
    lamp = np.stack([np.cos(azimuth), np.sin(azimuth), np.ones(N_LED)], -1) / np.sqrt(2)
    mask = ball_normal().any(axis=-1)
    return Light(lamp[None].astype(np.float32), np.arange(N_LED) % 4, CONSTANT_LIGHT, mask)


@cache
def ball_recording(crossfade: float = 1.0) -> Recording:
    return recorded(pixel=PIXEL.idealised(), rounds=3, crossfade=crossfade)
