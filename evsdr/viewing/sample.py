"""The events of some pixels, pixel after pixel, on which all is measured that needs no picture."""

from dataclasses import dataclass

import numpy as np

from evsdr.events.phase import position
from evsdr.records import Events, Schedule
from evsdr.rig.repetition import LONGEST_US

N_PIXEL = 4096  # that are enough: shares are then known to 1 %
FEWEST = 8  # events of a pixel that tell something


@dataclass(frozen=True)
class Sample:
    """Events of some pixels, pixel after pixel and in time order within each.

    Attributes
    ----------
    place : (n_pixel,) int64
        Where the pixels lie in the image, row-major.
    pixel : (n_event,) int64
        Number of the pixel, 0 .. n_pixel - 1.
    t : (n_event,) int64
        Time [us].
    p : (n_event,) int8
        +1 or -1.
    """

    place: np.ndarray
    pixel: np.ndarray
    t: np.ndarray
    p: np.ndarray

    def __len__(self) -> int:
        return len(self.t)

    @property
    def together(self) -> np.ndarray:
        """Tell (n_event - 1,) whether an event and the next are of one pixel."""
        return self.pixel[1:] == self.pixel[:-1]


def take_sample(events: Events, shape: tuple[int, int], hot: np.ndarray, n_pixel: int = N_PIXEL) -> Sample:
    """Take some pixels at random that fire, and are not hot (height, width)."""
    pixel = events.y.astype(np.int64) * shape[1] + events.x
    count = np.bincount(pixel, minlength=shape[0] * shape[1])
    some = np.flatnonzero((count >= FEWEST) & ~hot.ravel())
    place = np.sort(np.random.default_rng(0).permutation(some)[:n_pixel])
    number = np.full(len(count), -1)
    number[place] = np.arange(len(place))
    number = number[pixel]
    kept = np.flatnonzero((number >= 0) & (events.t < events.t[0] + LONGEST_US))
    kept = kept[np.argsort(number[kept], kind="stable")]
    return Sample(place, number[kept], events.t[kept], (2 * events.p[kept] - 1).astype(np.int8))


def slots_of(
    sample: Sample, schedule: Schedule, starts: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give the slot of each event, the share of it that is over, and whether rounds are under way."""
    at, inside = position(sample.t, schedule, starts)
    slot = np.minimum(np.floor(at), len(schedule.order) - 1).astype(np.int64)
    return slot, at - slot, inside


def coherence(sample: Sample, schedule: Schedule, starts: np.ndarray) -> float:
    """Give how far the events of a pixel in a slot agree, over all rounds: 1 if all are of one polarity.

    While one LED fades into the next the light of a pixel only rises, or only falls.
    """
    slot, _, inside = slots_of(sample, schedule, starts)
    n_slot = len(schedule.order)
    cell = (sample.pixel * n_slot + slot)[inside]
    net = np.bincount(cell, sample.p[inside])
    count = np.bincount(cell)
    several = count > 1
    return float(np.abs(net[several]).sum() / max(count[several].sum(), 1))
