"""Recordings of a ball that need no renderer, with the faults that `evsdr.view` should find."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from evsdr.events.pixel import EventPixel
from evsdr.events.record import record, ring_schedule
from evsdr.records import Recording
from evsdr.rig.camera_file import Edges
from evsdr.viewing.source import Watched
from experiments.lamp import under_a_lamp

SIZE, N_LED, CONSTANT_LIGHT = 20, 12, 0.05
PIXEL = EventPixel(hot_fraction=0)


@cache
def ball_signal() -> np.ndarray:
    """Give the light (n_led, height, width) of LEDs around a ball, of four bands that reflect differently."""
    x, y = np.meshgrid(np.linspace(-1.1, 1.1, SIZE), np.linspace(1.1, -1.1, SIZE))
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    azimuth = 2 * np.pi * np.arange(N_LED) / N_LED
    lamp = np.stack([np.cos(azimuth), np.sin(azimuth), np.ones(N_LED)]) / np.sqrt(2)
    shade = np.einsum("kj,khw->jhw", lamp, np.stack([x, y, z])).clip(min=0) * (z > 0.05)
    band = np.array([0.2, 0.8, 0.4, 0.6])[np.arange(N_LED) % 4]
    return (shade * band[:, None, None]).astype(np.float32)


def recorded(
    signal: np.ndarray | None = None,
    slot_us: float = 20_000.0,
    rounds: int = 4,
    pixel: EventPixel = PIXEL,
    crossfade: float = 1.0,
) -> Recording:
    """Record the ball, or other light."""
    schedule = replace(ring_schedule(N_LED), slot_us=slot_us, crossfade=crossfade)
    return record(ball_signal() if signal is None else signal, CONSTANT_LIGHT, pixel, schedule, rounds)


def lamp_recording(hz: float, slot_us: float = 20_000.0) -> Recording:
    """Record the ball while a lamp on the mains shines."""
    schedule = replace(ring_schedule(N_LED), slot_us=slot_us)
    return under_a_lamp(ball_signal(), CONSTANT_LIGHT, schedule, hz, rounds=3, pixel=PIXEL)


def watched(recording: Recording, triggers: bool = True, **schedule) -> Watched:
    """Give a recording as a file tells it, with a schedule that may be told wrong."""
    starts = np.asarray(recording.round_start_us)[: None if triggers else 0]
    edges = Edges(np.ones(len(starts), np.int8), starts, np.zeros(len(starts), np.int16))
    told = replace(recording.schedule, **schedule)
    return Watched(Path("ball.h5"), recording.events, edges, recording.sensor, told, len(recording.events))
