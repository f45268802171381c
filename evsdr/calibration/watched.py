"""Pixels that look at known points of a ball or patch under the ring, with their events."""

from dataclasses import dataclass

import numpy as np

from evsdr.errors import InputError
from evsdr.records import Recording
from evsdr.solve.shared.pixels import events_of

MOST_EVENTS = 40_000  # that are fitted; more change nothing
LEAST_CROSSFADE = 0.05  # of a slot: after a hard switch an event tells no exact change


@dataclass(frozen=True)
class Watched:
    """Some pixels of one recording.

    Attributes
    ----------
    number : (n_pixel,) int
        y * width + x.
    point : (n_pixel,) int
        Which surface point each sees.
    events : tuple
        See `kernel.pixel_sums`; times in slots.
    order : (n_slot,) int
        LED of each slot; -1 is dark.
    threshold : (n_pixel, 2) float
        C_on and C_off as told.
    own_thresholds : bool
        Whether they are told as one value for all pixels, so that each pixel's own are unknown.
    crossfade, slot_us, refractory_us : float
    """

    number: np.ndarray
    point: np.ndarray
    events: tuple
    order: np.ndarray
    threshold: np.ndarray
    own_thresholds: bool
    crossfade: float
    slot_us: float
    refractory_us: float

    @property
    def pixel_of_event(self) -> np.ndarray:
        """Number of the pixel of each event."""
        return np.repeat(self.number, np.diff(self.events[0]))


def watch(recording: Recording, mask: np.ndarray, point: np.ndarray, most: int, seed: int) -> Watched:
    """Collect some pixels of a recording under the ring.

    Parameters
    ----------
    mask : (height, width) bool
        Pixels that count; if they fire more than `most` events, some of them are drawn.
    point : (height, width) int
        Surface point of each pixel.

    Raises
    ------
    InputError
        The LEDs switch hard, or no pixel fires twice.
    """
    schedule, sensor, events = recording.schedule, recording.sensor, recording.events
    if schedule.crossfade < LEAST_CROSSFADE:
        raise InputError(
            f"schedule/crossfade is {schedule.crossfade:g}, and after a hard switch events tell no exact "
            f"change of light; record the calibration with a crossfade of {LEAST_CROSSFADE:g} or more, "
            "best 1."
        )
    where = events.y.astype(np.int64) * sensor.width + events.x
    count = np.bincount(where, minlength=mask.size) * mask.ravel()
    number = np.random.default_rng(seed).permutation(np.flatnonzero(count > 1))
    if not len(number):
        raise InputError(
            "no two events of a pixel follow each other within the rounds of the ring; check the triggers or "
            "start_us, and the mask."
        )
    number = np.sort(number[: max(np.searchsorted(np.cumsum(count[number]), most, side="right"), 1)])
    both = sensor.contrast_threshold_on, sensor.contrast_threshold_off
    threshold = [np.broadcast_to(np.asarray(c, float), mask.shape).ravel()[number] for c in both]
    return Watched(
        number,
        point.ravel()[number],
        events_of(recording, number),
        schedule.order,
        np.stack(threshold, axis=-1),
        all(np.ndim(c) == 0 for c in both),
        float(schedule.crossfade),
        float(schedule.slot_us),
        float(sensor.refractory_us),
    )
