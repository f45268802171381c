"""What a camera's file holds before it is joined with the ring: events, edges of the trigger inputs, size."""

import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from evsdr.errors import InputError, InputWarning
from evsdr.records import Events

OUTSIDE_SHARE = 0.01  # of the events; with more outside the sensor, its size must be wrong
EVENT_FIELDS = {"x": np.uint16, "y": np.uint16, "p": np.int8, "t": np.int64}
EDGE_FIELDS = {"p": np.int8, "t": np.int64, "id": np.int16}
LARGEST_STEP_BACK_US = 10_000  # that is sorted; more is not one recording


@dataclass(frozen=True)
class Edges:
    """Edges of the trigger inputs, in time order.

    Attributes
    ----------
    p : (n_edge,) int8
        1 rises, 0 falls.
    t : (n_edge,) int64
        Time on the events' clock [us].
    id : (n_edge,) int16
        Trigger input.
    """

    p: np.ndarray
    t: np.ndarray
    id: np.ndarray

    def __len__(self) -> int:
        return len(self.t)


def no_edges() -> Edges:
    """Give the edges of a recording that has none."""
    return Edges(*(np.empty(0, kind) for kind in EDGE_FIELDS.values()))


@dataclass(frozen=True)
class CameraRecording:
    """A camera's file.

    Attributes
    ----------
    width, height : int
        Of the sensor, or of the region cut from it [pixels].
    """

    width: int
    height: int
    events: Events
    edges: Edges


def read_size(path: Path, text: str, place: str, most: int) -> tuple[int, int]:
    """Read a sensor's width and height.

    Parameters
    ----------
    path : Path
        Its file, for the sentence.
    text : str
        Such as `1280x720`.
    place : str
        What of the file should tell it, with its verb: `header does`, `attributes do`.
    most : int
        Pixels along either side.

    Raises
    ------
    InputError
        The text is no size.
    """
    size = re.fullmatch(r"(\d+)x(\d+)", text)
    if not size or not all(0 < int(number) <= most for number in size.groups()):
        raise InputError(f"{path}: its {place} not tell the sensor's size; give it by --sensor-size.")
    return int(size[1]), int(size[2])


def check_recording(path: Path, recording: CameraRecording, n_outside: int = 0) -> CameraRecording:
    """Give a recording in time order whose events lie inside the sensor.

    Parameters
    ----------
    path : Path
        Its file, for the sentences.
    recording : CameraRecording
        As decoded.
    n_outside : int
        Events outside the sensor that were left out already.

    Raises
    ------
    InputError
        There are no events, many lie outside the sensor, or time steps back far.

    Warns
    -----
    InputWarning
        Some events lay outside the sensor, or not in time order.
    """
    width, height, events, edges = recording.width, recording.height, recording.events, recording.edges
    if len(events) and (events.x.max() >= width or events.y.max() >= height):
        inside = (events.x < width) & (events.y < height)
        n_outside += int(np.count_nonzero(~inside))
        events = _select(events, inside)
    n_event = len(events)
    if n_outside > OUTSIDE_SHARE * (n_event + n_outside):
        raise InputError(
            f"{path}: {n_outside:,} of {n_event + n_outside:,} events lie outside the sensor of {width} x "
            f"{height} pixels; give the true size by --sensor-size, or the file is damaged."
        )
    if n_event == 0:
        raise InputError(f"{path}: it holds no events; record again with the lens open and the ring on.")
    if n_outside:
        warn(f"{path}: {n_outside:,} events outside the sensor of {width} x {height} pixels are left out.")
    if (events.t[1:] < events.t[:-1]).any():
        events = _sort(path, events)
    order = np.argsort(edges.t, kind="stable")
    edges = Edges(edges.p[order], edges.t[order], edges.id[order])
    return CameraRecording(width, height, events, edges)


def crop(recording: CameraRecording, left: int, top: int, width: int, height: int) -> CameraRecording:
    """Cut a region out of the sensor; its pixels are counted from its own left and top.

    Raises
    ------
    InputError
        The region does not lie inside the sensor.
    """
    inside = 0 <= left < left + width <= recording.width and 0 <= top < top + height <= recording.height
    if not inside:
        raise InputError(
            f"--crop {left} {top} {width} {height} does not lie inside the sensor of {recording.width} x "
            f"{recording.height} pixels; give left, top, width and height of a region that does."
        )
    events = recording.events
    keep = (events.x >= left) & (events.x < left + width) & (events.y >= top) & (events.y < top + height)
    events = _select(events, keep)
    events = replace(events, x=events.x - np.uint16(left), y=events.y - np.uint16(top))
    return CameraRecording(width, height, events, recording.edges)


def between(events: Events, begin_us: float, end_us: float) -> Events:
    """Give the events with begin <= t < end."""
    first, last = np.searchsorted(events.t, [begin_us, end_us])
    return _select(events, slice(first, last))


def _sort(path: Path, events: Events) -> Events:
    """Sort events whose time steps back a little; refuse more."""
    step = np.diff(events.t)
    k = step.argmin()
    if step[k] < -LARGEST_STEP_BACK_US:
        raise InputError(
            f"{path}: time steps back by {-1e-6 * step[k]:.3f} s after {1e-6 * events.t[k]:.3f} s; "
            "the file is damaged, or several recordings in one: record again."
        )
    n_back = np.count_nonzero(step < 0)
    warn(f"{path}: time steps back {n_back:,} times, by {-step[k]} us at most; the events are sorted.")
    return _select(events, np.argsort(events.t, kind="stable"))


def _select(events: Events, which: np.ndarray | slice) -> Events:
    return Events(events.x[which], events.y[which], events.p[which], events.t[which])


def warn(sentence: str) -> None:
    """Warn of a file that is read nevertheless."""
    warnings.warn(InputWarning(sentence), stacklevel=3)
