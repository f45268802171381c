"""A recording: what event pixels make of the ring's light."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.records import Recording, Schedule, Sensor

Thresholds = Literal["calibrated", "nominal"]


def ring_schedule(
    n_led: int, order: Sequence[int] | None = None, slot_us: float = 20_000.0, crossfade: float = 1.0
) -> Schedule:
    """Give a schedule of a ring; without an order each LED is lit in turn."""
    return Schedule(np.asarray(range(n_led) if order is None else order, np.int32), slot_us, crossfade)


def record(
    signal: np.ndarray,
    constant_light: float,
    pixel: EventPixel,
    schedule: Schedule,
    rounds: int,
    seed: int = 0,
    thresholds: Thresholds = "calibrated",
    led_rise_us: float = 0.0,
    progress: Callable[[str, float], None] | None = None,
) -> Recording:
    """Let event pixels watch the ring go round.

    Parameters
    ----------
    signal : (n_led, height, width) float
        A_xj, 0 or more; I = 1 is a white patch that faces an LED.
    constant_light : float
        C_w.
    pixel : EventPixel
    schedule : Schedule
        Which LED is lit when.
    rounds : int
        How often the ring goes round.
    seed : int
        Of the fixed patterns and of all noise.
    thresholds : str
        What the recording tells of the thresholds: those of each pixel, or one nominal value.
    led_rise_us : float
        Time constant of an LED's light [us].
    progress : callable (detail, share), optional
        Called now and then.

    Raises
    ------
    InputError
        An argument can't be used.
    """
    events, on, off, round_start_us = simulate_events(
        signal,
        constant_light,
        schedule,
        rounds,
        pixel,
        seed=seed,
        led_rise_us=led_rise_us,
        progress=progress and (lambda done, total: progress("", done / total)),
    )
    if thresholds == "nominal" or pixel.spread_on == pixel.spread_off == 0:
        on, off = pixel.contrast_threshold_on, pixel.contrast_threshold_off
    _, height, width = signal.shape
    return Recording(events, Sensor(width, height, on, off, pixel.refractory_us), schedule, round_start_us)
