"""Event pixels under the ring's light: fixed patterns, and the events of a recording.

How a pixel turns light into events is in `pixel_kernel`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evsdr.errors import InputError
from evsdr.events.pixel import SMALLEST_THRESHOLD, EventPixel
from evsdr.events.pixel_kernel import NOISE_STEP, Model, gather, run_pixels
from evsdr.events.sorting import sort_events
from evsdr.records import Events, Schedule

SPREAD_CORRELATION = -0.21  # between the fixed patterns of C_on and C_off, measured on 921,600 pixels
SMALLEST_LIGHT = 1e-6  # darkness, so that the logarithm stays finite,
DIM = 1e-3  # beneath light that is brighter than this somewhere; else in proportion
MOST_STEPS = 1e8  # of a pixel, some ten seconds; guessed
BLOCK = 4096  # pixels between two looks at the keyboard
ROOM = 256  # events of a pixel before it is done again with more room


@dataclass(frozen=True)
class FixedPattern:
    """What differs from pixel to pixel for good.

    Attributes
    ----------
    threshold_on, threshold_off : (height, width) float32
        Contrast thresholds.
    leak : (height, width) float64
        Drift of the reference [1/us].
    state : (height, width) uint64
        Where the random numbers of a pixel start.
    """

    threshold_on: np.ndarray
    threshold_off: np.ndarray
    leak: np.ndarray
    state: np.ndarray


@dataclass(frozen=True)
class Crossings:
    """Events at exact times, each pixel's own in time order.

    Attributes
    ----------
    pixel : (n_event,) int64
        y * width + x.
    polarity : (n_event,) int8
        +1 or -1.
    t_us : (n_event,) float64
        Time since the start of the schedule [us].
    """

    pixel: np.ndarray
    polarity: np.ndarray
    t_us: np.ndarray


def simulate_events(
    signal: np.ndarray,
    constant_light: float,
    schedule: Schedule,
    n_round: int,
    pixel: EventPixel,
    seed: int = 0,
    led_rise_us: float = 0.0,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Events, np.ndarray, np.ndarray, np.ndarray]:
    """Simulate the events of a ring that runs for some rounds.

    The reference is memorised at `schedule.start_us`, when the first LED is fully lit. The same seed gives
    the same events, whatever the number of threads.

    Parameters
    ----------
    signal : (n_led, height, width) float
        A_xj, 0 or more; I = 1 is a white patch that faces an LED.
    constant_light : float
        C_w; with an LED it makes 1e-6 at least, darkness is taken as that, or less beneath light of 1e-3 at most.
    schedule : Schedule
        Which LED is lit when.
    n_round : int
        Number of rounds.
    pixel : EventPixel
        The event pixel.
    seed : int
        Of the fixed patterns and of all noise.
    led_rise_us : float
        Time constant of each LED's light [us].
    progress : callable(done, total), optional
        Called with numbers of pixels now and then.

    Returns
    -------
    events : Events
        Sorted by time, then by pixel. Times are rounded to the nearest us; the pixel itself runs on exact
        ones.
    threshold_on, threshold_off : (height, width) float32
        Contrast thresholds with their fixed pattern.
    round_start_us : (n_round + 1,) int64
        Starts of the rounds and end of the last [us].

    Raises
    ------
    InputError
        An argument can't be used.
    """
    _check(signal, constant_light, schedule, n_round, seed, led_rise_us)
    height, width = signal.shape[1:]
    fixed = draw_pattern(pixel, height, width, seed)
    found = find_crossings(signal, constant_light, schedule, n_round, pixel, fixed, led_rise_us, progress)
    events = Events(*sort_events(found.pixel, found.polarity, found.t_us, float(schedule.start_us), width))
    round_us = schedule.slot_us * len(schedule.order)
    round_start = np.rint(np.arange(n_round + 1) * round_us + schedule.start_us).astype(np.int64)
    return events, fixed.threshold_on, fixed.threshold_off, round_start


def _check(signal, constant_light, schedule, n_round, seed, led_rise_us) -> None:
    if signal.ndim != 3 or not signal.size or max(signal.shape[1:]) > 65536:
        raise InputError(f"signal must have shape (n_led, height, width), got {signal.shape}.")
    if not (np.isfinite(signal).all() and signal.min() >= 0):
        raise InputError("signal holds numbers below 0 or not finite; render the LED images again.")
    order, n_led = np.asarray(schedule.order), len(signal)
    if order.ndim != 1 or not order.size or order.min() < -1 or order.max() >= n_led:
        raise InputError(f"order must list LEDs 0 to {n_led - 1}, or -1 for none; correct the schedule.")
    for name, value, right in (
        ("constant_light", constant_light, 0 <= constant_light < np.inf),
        ("slot_us", schedule.slot_us, 0 < schedule.slot_us < np.inf),
        ("crossfade", schedule.crossfade, 0 <= schedule.crossfade <= 1),
        ("start_us", schedule.start_us, np.isfinite(schedule.start_us)),
        ("n_round", n_round, n_round >= 1),
        ("seed", seed, seed >= 0),
        ("led_rise_us", led_rise_us, 0 <= led_rise_us < np.inf),
    ):
        if not right:
            raise InputError(f"{name} is {value:g}, which makes no sense; correct it.")


def draw_pattern(pixel: EventPixel, height: int, width: int, seed: int) -> FixedPattern:
    """Draw the fixed pattern of a sensor: thresholds, hot pixels and random streams."""
    rng = np.random.default_rng(seed)
    shape = (height, width)
    first, second = rng.standard_normal((2, *shape))
    second = SPREAD_CORRELATION * first + np.sqrt(1 - SPREAD_CORRELATION**2) * second
    threshold_on = np.float32(pixel.contrast_threshold_on + pixel.spread_on * first)
    threshold_off = np.float32(pixel.contrast_threshold_off + pixel.spread_off * second)
    threshold_on = np.maximum(threshold_on, np.float32(SMALLEST_THRESHOLD))
    threshold_off = np.maximum(threshold_off, np.float32(SMALLEST_THRESHOLD))
    hot = rng.random(shape) < pixel.hot_fraction
    leak = np.where(hot, pixel.hot_hz, pixel.leak_hz) * 1e-6 * threshold_on
    state = rng.integers(0, 2**64, shape, np.uint64)
    return FixedPattern(threshold_on, threshold_off, leak, state)


def find_crossings(
    signal: np.ndarray,
    constant_light: float,
    schedule: Schedule,
    n_round: int,
    pixel: EventPixel,
    fixed: FixedPattern,
    led_rise_us: float = 0.0,
    progress: Callable[[int, int], None] | None = None,
) -> Crossings:
    """Find all events at their exact times; the arguments are those of `simulate_events`, unchecked."""
    cutoff = 2e-6 * np.pi * pixel.cutoff_hz
    variance = cutoff / (2 * pixel.photon_rate_per_us) if pixel.photon_rate_per_us > 0 else 0.0
    model = Model(
        n_round=n_round,
        slot_us=float(schedule.slot_us),
        crossfade=float(schedule.crossfade),
        led_rise_us=float(led_rise_us),
        led_rate=1 / led_rise_us if led_rise_us > 0 else 0.0,
        cutoff=cutoff,
        noise=float(np.sqrt(variance)),
        event_noise=float(pixel.event_noise),
        refractory_us=float(pixel.refractory_us),
    )
    if model.noise > 0:
        _check_steps(model, float(signal.max()), len(schedule.order))
    n_pixel = signal[0].size
    darkness = SMALLEST_LIGHT * min((float(signal.max()) + constant_light) / DIM or 1.0, 1.0)
    lit = np.append(schedule.order, schedule.order[0])
    signal = signal.reshape(len(signal), n_pixel)
    maps = [np.ravel(m) for m in (fixed.threshold_on, fixed.threshold_off, fixed.leak, fixed.state)]
    parts, t_us, polarity = [], np.empty((0, 0)), np.empty((0, 0), np.int8)
    for begin in range(0, n_pixel, BLOCK):
        todo, room, start = np.arange(begin, min(begin + BLOCK, n_pixel)), ROOM, None
        while len(todo):
            light = signal[lit, todo[:, None]].astype(np.float64)
            light[:, lit < 0] = 0
            light = np.maximum(light + constant_light, darkness)
            if t_us.shape[0] < len(todo) or t_us.shape[1] < room:
                t_us, polarity = np.empty((len(todo), room)), np.empty((len(todo), room), np.int8)
            count, room = np.empty(len(todo), np.int64), t_us.shape[1]
            run_pixels(light, *(m[todo] for m in maps), model, t_us, polarity, count)
            if start is None:
                start, n = np.cumsum(count) - count, int(count.sum())
                parts.append((np.empty(n, np.int64), np.empty(n, np.int8), np.empty(n)))
            gather(todo, start[todo - begin], count, t_us, polarity, *parts[-1])
            todo, room = todo[count > room], int(count.max())
        if progress:
            progress(min(begin + BLOCK, n_pixel), n_pixel)
    return Crossings(*(np.concatenate(part) for part in zip(*parts)))


def _check_steps(model: Model, light: float, n_slot: int) -> None:
    """Refuse light of LEDs in which photoreceptors are so fast that their noise takes too many steps; beside a constant
    light alone, thresholds are out of its reach."""
    duration = model.slot_us * n_slot * model.n_round
    if model.cutoff * light * duration / NOISE_STEP > MOST_STEPS:
        raise InputError(
            f"a pixel's light of an LED is up to {light:.3g}, in which photoreceptors are too fast to be simulated for "
            f"{duration / 1e6:.3g} s: lower the powers of the LEDs, cutoff_hz or the rounds, or take no noise."
        )
