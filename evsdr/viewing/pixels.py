"""Pixel by pixel: how often each fires, which are hot or silent, and which hardly keep up with the light."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, uniform_filter

from evsdr.rig.health import HOT_FACTOR
from evsdr.viewing.source import Watched

HOT_HZ = 100.0  # at least, above its neighbours
LIT = 8  # events of a pixel that sees the ring, in the recording
QUICK = (
    2.0  # refractory periods: events nearer to each other have lost a good part of the change between them
)
# Of a pixel's events; measured: 0 for fading LEDs, 0.05 to 0.13 where the refractory period is too long for the slots
SATURATED = 0.05
SILENT_BESIDE = 5.0  # times `LIT` that the neighbours of a silent pixel fire


@dataclass(frozen=True)
class Pixels:
    """What each pixel (height, width) does.

    Attributes
    ----------
    off, on : int
        Events.
    lit, hot, silent : bool
    quick : float
        Share of the events that follow another of the pixel within `QUICK` refractory periods.
    shortest_us : float
        Time between two events of a pixel than which one in a thousand is shorter [us].
    """

    off: np.ndarray
    on: np.ndarray
    lit: np.ndarray
    hot: np.ndarray
    silent: np.ndarray
    quick: np.ndarray
    shortest_us: float

    @property
    def saturated(self) -> np.ndarray:
        """Tell which pixels lose much of the light's change."""
        return self.lit & ~self.hot & (self.quick > SATURATED)


def look_at_pixels(watched: Watched) -> Pixels:
    """Count, pixel by pixel."""
    events, shape = watched.events, watched.shape
    n = shape[0] * shape[1]
    pixel = events.y.astype(np.int64) * shape[1] + events.x
    on = np.bincount(pixel[events.p == 1], minlength=n).reshape(shape)
    count = np.bincount(pixel, minlength=n).reshape(shape)
    beside = median_filter(count, 3, mode="nearest")
    hot = count > HOT_FACTOR * beside + HOT_HZ * watched.seconds
    lit = count >= LIT
    order = np.argsort(pixel, kind="stable")
    apart = np.diff(events.t[order])[pixel[order][1:] == pixel[order][:-1]]
    second = pixel[order][1:][pixel[order][1:] == pixel[order][:-1]]
    near = apart < QUICK * watched.sensor.refractory_us
    quick = np.bincount(second[near], minlength=n).reshape(shape) / np.maximum(count, 1)
    shortest = float(np.percentile(apart, 0.1)) if len(apart) else 0.0
    empty = count == 0
    alone = (
        uniform_filter(empty.astype(float), 3, mode="nearest") < 1.5 / 9
    )  # else a dark line, as between patches
    silent = empty & alone & (beside > SILENT_BESIDE * LIT)
    return Pixels(count - on, on, lit, hot, silent, quick, shortest)
