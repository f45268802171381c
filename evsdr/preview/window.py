"""The events of the last round, pixel by pixel, and the clock of the ring while they came."""

from dataclasses import dataclass

import numpy as np

from evsdr.events.pair_kernel import sort_by_pixel
from evsdr.events.phase import ROUND_TOLERANCE
from evsdr.records import Recording, Schedule


@dataclass(frozen=True)
class Window:
    """Events of some pixels in a short time.

    Attributes
    ----------
    offset, p, t
        See `events.pair_kernel.sort_by_pixel`.
    clock : (float, float)
        Start of a round, and length of a slot [us].
    """

    offset: np.ndarray
    p: np.ndarray
    t: np.ndarray
    clock: tuple[float, float]


def take_window(recording: Recording, end_us: float, rounds: float, mask: np.ndarray) -> Window:
    """Give the events of the last rounds before a time.

    Parameters
    ----------
    recording : Recording
    end_us : float
        What comes later is not looked at.
    rounds : float
        How many.
    mask : (height, width) bool
        Pixels whose events are kept.
    """
    events = recording.events
    start_us, slot_us = clock(recording.schedule, recording.round_start_us, end_us)
    length = rounds * slot_us * len(recording.schedule.order)
    first, last = np.searchsorted(events.t, [end_us - length, end_us])
    some = (a[first:last] for a in (events.x, events.y, events.p, events.t))
    return Window(*sort_by_pixel(*some, mask), (start_us, slot_us))


def clock(schedule: Schedule, round_start_us: np.ndarray, end_us: float) -> tuple[float, float]:
    """Give the start of a round and the length of a slot [us] that the last triggers before a time tell.

    `slot_us` of the schedule counts where these are not a round apart.
    """
    told = np.asarray(round_start_us)[: np.searchsorted(round_start_us, end_us, side="right")]
    if not len(told):
        return float(schedule.start_us), schedule.slot_us
    slot_us = float(told[-1] - told[-2]) / len(schedule.order) if len(told) > 1 else schedule.slot_us
    near = abs(slot_us / schedule.slot_us - 1) <= ROUND_TOLERANCE
    return float(told[-1]), slot_us if near else schedule.slot_us
