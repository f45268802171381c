"""A recording played back: maps as they would come while it runs, or as fast as they can be made."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from evsdr.errors import InputError
from evsdr.preview.decoder import Decoder
from evsdr.preview.window import clock, take_window
from evsdr.records import Recording


@dataclass(frozen=True)
class Frame:
    """One map.

    Attributes
    ----------
    end_us : float
        Time of the recording up to which its events count [us].
    normal : (height, width, 3) float32
    known : (height, width) bool
    seconds, cpu_seconds : float
        That it took, and of all cores.
    """

    end_us: float
    normal: np.ndarray
    known: np.ndarray
    seconds: float
    cpu_seconds: float


def times(recording: Recording, rounds: float, hz: float) -> np.ndarray:
    """Give the times of maps [us]: from the end of the first rounds on, so many a second of the recording.

    Raises
    ------
    InputError
        It is shorter than these rounds.
    """
    starts, events = np.asarray(recording.round_start_us), recording.events
    last = starts[-1] if len(starts) > 1 else events.t[-1] + 1 if len(events) else 0
    begin, slot_us = clock(recording.schedule, starts[:1], np.inf)
    first = begin + rounds * slot_us * len(recording.schedule.order)
    if last < first - 0.5 * slot_us:
        raise InputError(
            f"{recording.source}: it lasts {1e-6 * (last - begin):.3g} s but --rounds {rounds:g} are "
            f"{1e-6 * (first - begin):.3g} s; record longer, or ask for fewer rounds."
        )
    n = int((last - first) * 1e-6 * hz) + 1 if last > first else 1
    return last - np.arange(n)[::-1] * 1e6 / hz


def replay(
    recording: Recording,
    decoder: Decoder,
    mask: np.ndarray,
    rounds: float,
    end_us: np.ndarray,
    realtime: bool,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[Frame]:
    """Make a map at each time.

    Parameters
    ----------
    end_us : (n,) float
        Times of the recording [us], growing.
    realtime : bool
        Wait for these times; maps for which it is too late are left out, but the last.
    """
    begin = time.perf_counter()
    for k, end in enumerate(end_us):
        if realtime:
            early = 1e-6 * (end - end_us[0]) - (time.perf_counter() - begin)
            if early > 0:
                sleep(early)
            elif k + 1 < len(end_us) and -early > 1e-6 * (end_us[k + 1] - end):
                continue
        wall, cpu = time.perf_counter(), time.process_time()
        normal, known = decoder(take_window(recording, end, rounds, mask))
        yield Frame(end, normal, known, time.perf_counter() - wall, time.process_time() - cpu)
