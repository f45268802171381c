"""The ball as a camera writes it: a RAW file of events and of triggers at the start of each round."""

from functools import cache

import numpy as np

from evsdr.records import Recording
from evsdr.rig.camera_file import CameraRecording, Edges, between
from tests.support.camera_files import encode_raw
from tests.support.watched_files import recorded


@cache
def ball() -> Recording:
    return recorded(slot_us=5000.0)


def as_camera(recording: Recording, triggers: bool = True, begin: float = -np.inf, end: float = np.inf):
    """Give a recording, or a time of it, as a camera tells it."""
    starts = np.asarray(recording.round_start_us)[: None if triggers else 0]
    starts = starts[(starts >= begin) & (starts < end)]
    edges = Edges(np.ones(len(starts), np.int8), starts, np.zeros(len(starts), np.int16))
    sensor = recording.sensor
    return CameraRecording(sensor.width, sensor.height, between(recording.events, begin, end), edges)


@cache
def ball_raw() -> bytes:
    return encode_raw(as_camera(ball()), "EVT3")
