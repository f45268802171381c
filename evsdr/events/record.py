"""A recording: what event pixels make of the ring's light."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.records import Recording, Schedule, Sensor

Thresholds = Literal["calibrated", "nominal"]
FLICKER_US, FLICKER_ROUNDS = 400_000.0, 20  # of a slot: slow against photoreceptors in dim light


def flicker_order(order: Sequence[int]) -> tuple[int, int, int]:
    """Give the slots of a flicker by the first LED of an order: it fades out, stays dark, and fades in."""
    return next((led for led in order if led >= 0), 0), -1, -1


def ring_schedule(
    n_led: int,
    order: Sequence[int] | None = None,
    slot_us: float = 20_000.0,
    crossfade: float = 1.0,
    trim: Sequence[float] | None = None,
) -> Schedule:
    """Give a schedule of a ring; without an order each LED is lit in turn, without a trim at full brightness."""
    order = np.asarray(range(n_led) if order is None else order, np.int32)
    return Schedule(order, slot_us, crossfade, trim=None if trim is None else np.asarray(trim, np.float32))


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
    if schedule.trim is not None:
        trim = np.asarray(schedule.trim, np.float32)
        if len(trim) < len(signal) or not ((trim >= 0) & (trim <= 1)).all():
            raise InputError(
                f"trim must hold {len(signal)} numbers from 0 to 1, one for each LED; correct it."
            )
        signal = signal * trim[: len(signal), None, None]
    from evsdr.events.simulator import simulate_events  # loads numba, which help must not

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
