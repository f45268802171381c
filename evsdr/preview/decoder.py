"""Normals of the last round: each pixel's slopes and log reflectances move on from those of the map before."""

from dataclasses import dataclass

import numpy as np

from evsdr.events.pixel import SMALLEST_THRESHOLD
from evsdr.preview.kernels import REFLECTANCE, solve_pixels
from evsdr.preview.window import Window
from evsdr.records import Recording
from evsdr.threads import N_CHUNK, in_chunks

# Softness of the horizon and steps: of the first map, whose pixels face the camera to start with, and of each; measured
BEGINNING = ((0.3, 8), (0.1, 8))
EACH = (0.03, 1)
FEWEST = 6  # events of a pixel that tell a normal; guessed
DARKEST = 1e-4  # constant light, of the mean irradiance, where there is none; guessed


@dataclass(frozen=True)
class Light:
    """What the LEDs send to each pixel.

    Attributes
    ----------
    vector : (n_pixel or 1, n_led, 3) float32
        Irradiance times direction to the LED, camera frame; 0 in cast shadow.
    band : (n_led,) int64
        Band of each LED.
    constant : float
        C_w, above 0.
    mask : (height, width) bool
        Pixels of the object.
    """

    vector: np.ndarray
    band: np.ndarray
    constant: float
    mask: np.ndarray


def light_of(illumination, mask: np.ndarray) -> Light:
    """Give the light of a `model.illumination.Illumination` as arrays, for the pixels of an object (height, width)."""
    pairs = zip(illumination.irradiance, illumination.direction)
    rows = [[irradiance.numpy() * c.numpy() for c in direction] for irradiance, direction in pairs]
    width = max(len(c) for row in rows for c in row)
    vector = np.stack([np.stack([np.broadcast_to(c, width) for c in row], -1) for row in rows], 1)
    irradiance = np.mean([i.numpy().mean() for i in illumination.irradiance])
    constant = max(float(illumination.constant_light.numpy()[0]), DARKEST * float(irradiance))
    return Light(
        np.ascontiguousarray(vector, np.float32), np.array(illumination.band, np.int64), constant, mask
    )


class Decoder:
    """Turns windows of events into normals, one after the other."""

    def __init__(self, light: Light, recording: Recording):
        sensor, schedule = recording.sensor, recording.schedule
        names = ("contrast_threshold_on", "contrast_threshold_off")
        told = (np.broadcast_to(getattr(sensor, name), light.mask.shape) for name in names)
        self._thresholds = [np.maximum(t.ravel(), SMALLEST_THRESHOLD).astype(np.float64) for t in told]
        self._rest = float(sensor.refractory_us)
        order = np.asarray(schedule.order, np.int64)
        self._ring = order, light.band, float(schedule.crossfade), light.constant
        self._light = light
        self._theta = np.zeros((light.mask.size, 3 + light.band.max()))
        self._theta[:, 2:] = REFLECTANCE
        self._steps = (*BEGINNING, EACH)

    def __call__(self, window: Window) -> tuple[np.ndarray, np.ndarray]:
        """Give unit normals (height, width, 3) float32, and where they are known (height, width) bool.

        Elsewhere they face the camera.
        """
        known = self._light.mask.ravel() & (np.diff(window.offset) >= FEWEST)
        chunks = np.array_split(np.flatnonzero(known), N_CHUNK)
        events = window.offset, window.p, window.t
        steps, self._steps = self._steps, (EACH,)

        def solve(chunk: int) -> None:
            for step in steps:
                given = *self._thresholds, self._rest, window.clock, self._light.vector, *self._ring
                solve_pixels(chunks[chunk], *events, *given, *step, self._theta)

        in_chunks(solve)
        p, q = np.where(known, self._theta[:, :2].T, 0.0)
        normal = np.stack([-p, -q, np.ones_like(p)], -1) / np.sqrt(1 + p * p + q * q)[:, None]
        shape = self._light.mask.shape
        return normal.reshape(*shape, 3).astype(np.float32), known.reshape(shape)
