"""Event pixels under the ring's light, with exact crossing times.

The light I(t) of a pixel follows the schedule (see `ring_light`). With everything real on, a pixel obeys

    tau dv/dt = log I - v,      1 / tau = 2 pi cutoff_hz I            photoreceptor, slower in the dark
    q(t) = v(t) + noise(t) - reference + leak (t - t_ref)             what the comparators see

and fires at q = +C_on or q = -C_off. When the refractory period is over, the reference is memorised anew and
the leak starts again at t_ref. Without a photoreceptor v = log I.

The noise is the photo-electrons' shot noise, white in log I with density 1 / (photon_rate I), behind the same
photoreceptor. Cutoff and density both follow I, so its standard deviation sqrt(pi cutoff / photon_rate) is the
same in all light.

Time goes in steps in which log I, v and the leak change by CHANGE at most together. In a step log I is taken
as linear in the photoreceptor's own time, integral dt / tau, in which its answer is an exact exponential; the
noise is an exact Ornstein-Uhlenbeck step of at most NOISE_STEP tau near a threshold (longer where the noise
can't reach it), and linear inside. Crossings inside a step are found to rounding error. Without photoreceptor
log I itself is exact at any time; without leak and rise time too, steps span whole ramps and crossings are a
closed form.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from evsdr.errors import InputError
from evsdr.records import Events, Schedule

SPREAD_CORRELATION = -0.21  # between the fixed patterns of C_on and C_off, measured on 921,600 pixels
SMALLEST_THRESHOLD = 0.02  # a fixed pattern or its noise goes no lower
SMALLEST_LIGHT = 1e-6  # darkness, so that the logarithm stays finite
CHANGE = 0.05  # of log intensity in a step
MIN_STEP_US = 1e-3
NOISE_STEP = 0.5  # of the photoreceptor's time constant
FAR = 8.0  # standard deviations that the noise does not cross
CROSSING_TOLERANCE = 1e-12  # of log intensity
BLOCK = 4096  # pixels between two looks at the keyboard
ROOM = 256  # events of a pixel before it is done again with more room


@dataclass(frozen=True)
class EventPixel:
    """An event pixel; the defaults are an EVK4 (IMX636) at default biases.

    Attributes
    ----------
    contrast_threshold_on, contrast_threshold_off : float
        Change of natural log intensity that fires an event; 0.02 at least.
    spread_on, spread_off : float
        Standard deviation of the fixed, spatially white pattern added to each threshold.
    event_noise : float
        Relative standard deviation of the thresholds from one event to the next.
    refractory_us : float
        Time after an event until the reference is memorised anew [us].
    cutoff_hz : float
        Cutoff of the photoreceptor at I = 1 [Hz], proportional to I; 0 for none. The default lags by 53 us
        there and by 660 us at I = 0.08.
    photon_rate_per_us : float
        Photo-electrons at I = 1 [1/us]; 0 for no shot noise. The default makes noise of 0.01 behind the
        photoreceptor, 1/26 of the threshold: times jitter, and only the few pixels with the lowest thresholds
        fire in steady light.
    leak_hz : float
        ON events of a pixel at rest [Hz].
    hot_fraction, hot_hz : float
        Share of pixels that leak more, and how much [Hz].

    Raises
    ------
    InputError
        A value makes no sense.
    """

    contrast_threshold_on: float = 0.2525
    contrast_threshold_off: float = 0.3795
    spread_on: float = 0.049
    spread_off: float = 0.039
    event_noise: float = 0.02
    refractory_us: float = 52.0
    cutoff_hz: float = 3000.0
    photon_rate_per_us: float = 100.0
    leak_hz: float = 0.1
    hot_fraction: float = 1e-4
    hot_hz: float = 1000.0

    @classmethod
    def ideal(cls, threshold: float = 0.25, refractory_us: float = 52.0) -> "EventPixel":
        """Give a pixel without spread, noise, lag and leak."""
        off = {field.name: 0.0 for field in fields(cls)[2:]}
        return cls(threshold, threshold, **(off | {"refractory_us": refractory_us}))

    def __post_init__(self):
        for field in fields(self):
            value = getattr(self, field.name)
            smallest = SMALLEST_THRESHOLD if field.name.startswith("contrast") else 0
            if not smallest <= value < np.inf:
                raise InputError(f"{field.name} is {value:g}; give a number of {smallest:g} or more.")
        if self.hot_fraction > 1:
            raise InputError(f"hot_fraction is {self.hot_fraction:g}; give a share of the pixels, 0 to 1.")
        if self.photon_rate_per_us > 0 and self.cutoff_hz == 0:
            raise InputError(
                "photon_rate_per_us makes noise without bounds when cutoff_hz is 0; "
                "set photon_rate_per_us to 0 too, or give a cutoff."
            )


class _Model(NamedTuple):
    """What all pixels share; rates per us."""

    n_round: int
    slot_us: float
    crossfade: float
    led_rise_us: float
    led_rate: float  # 1 / led_rise_us, or 0
    cutoff: float  # 1 / tau at I = 1, or 0
    noise: float  # standard deviation of the shot noise behind the photoreceptor
    event_noise: float
    refractory_us: float


class _Step(NamedTuple):
    """A step of `length` us from x = 0: I(x) = flat + slope x + transient exp(-led_rate x), and its log."""

    length: float
    flat: float
    slope: float
    transient: float
    led_rate: float
    cutoff: float
    light: float
    light_gain: float
    log_light: float
    log_gain: float
    lagged: float  # v at x = 0
    noise: float
    noise_gain: float


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
        C_w; with an LED it makes 1e-6 at least, darkness is taken as that.
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
    t = np.rint(found.t_us + schedule.start_us).astype(np.int64)
    since_start = t - int(np.floor(schedule.start_us))
    order = np.argsort(since_start * (height * width) + found.pixel, kind="stable")
    y, x = np.divmod(found.pixel[order], width)
    p = (found.polarity[order] > 0).astype(np.int8)
    events = Events(x.astype(np.uint16), y.astype(np.uint16), p, t[order])
    round_us = schedule.slot_us * len(schedule.order)
    round_start = np.rint(np.arange(n_round + 1) * round_us + schedule.start_us).astype(np.int64)
    return events, fixed.threshold_on, fixed.threshold_off, round_start


def _check(signal, constant_light, schedule, n_round, seed, led_rise_us) -> None:
    if signal.ndim != 3 or not signal.size or max(signal.shape[1:]) > 65536:
        raise InputError(f"signal must have shape (n_led, height, width), got {signal.shape}; stack LED images.")
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
            raise InputError(f"{name} is {value:g}, which no ring can do; correct it.")


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
    model = _Model(
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
    n_pixel = signal[0].size
    lit = np.append(schedule.order, schedule.order[0])
    signal = signal.reshape(len(signal), n_pixel)
    maps = [np.ravel(m) for m in (fixed.threshold_on, fixed.threshold_off, fixed.leak, fixed.state)]
    parts = []
    for begin in range(0, n_pixel, BLOCK):
        todo, room = np.arange(begin, min(begin + BLOCK, n_pixel)), ROOM
        while len(todo):
            light = np.where(lit[:, None] < 0, 0.0, signal[lit][:, todo]) + constant_light
            light = np.ascontiguousarray(np.maximum(light, SMALLEST_LIGHT).T)
            t_us = np.empty((len(todo), room))
            polarity = np.empty((len(todo), room), np.int8)
            count = np.empty(len(todo), np.int64)
            _run_pixels(light, *(m[todo] for m in maps), model, t_us, polarity, count)
            count[count > room] *= -1
            used = np.arange(room) < count[:, None]
            parts.append((np.repeat(todo, np.maximum(count, 0)), polarity[used], t_us[used]))
            todo, room = todo[count < 0], -count.min()
        if progress:
            progress(min(begin + BLOCK, n_pixel), n_pixel)
    return Crossings(*(np.concatenate(part) for part in zip(*parts)))


# ---- one pixel -----------------------------------------------------------------------------------------


@njit(cache=True, parallel=True)
def _run_pixels(light, threshold_on, threshold_off, leak, state, model, t_us, polarity, count):
    for i in prange(len(light)):
        count[i] = _run_pixel(
            light[i], threshold_on[i], threshold_off[i], leak[i], state[i], model, t_us[i], polarity[i]
        )


@njit(cache=True, error_model="numpy")
def _run_pixel(light, threshold_on, threshold_off, leak, state, model, t_us, polarity):
    """Run one pixel; return its number of events, of which the first len(t_us) are written.

    `light` is I at full light of each slot, the first again after the last.
    """
    whole_ramps = model.cutoff == 0 and model.led_rate == 0 and leak == 0
    n_slot = len(light) - 1
    n_event = 0
    state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)
    state, normal, spare = _draw_normals(state)
    noise, spare_is_left = model.noise * normal, True
    glow, lagged = light[0], np.log(light[0])  # the LEDs' settled light, and v
    reference, t_reference = 0.0, 0.0
    waiting, ready = True, 0.0  # for the end of the refractory period

    for piece in range(2 * n_slot * model.n_round):
        k, fading = divmod(piece, 2)
        duration = model.slot_us * (model.crossfade if fading else 1 - model.crossfade)
        if duration <= 0:
            continue
        t_piece = k * model.slot_us + fading * (model.slot_us - duration)
        begin, end = light[k % n_slot], light[k % n_slot + fading]
        slope = (end - begin) / duration
        lag = slope * model.led_rise_us
        transient = glow - begin + lag if model.led_rate > 0 else 0.0
        now, log_now = begin - lag + transient, np.log(begin - lag + transient)
        if model.cutoff == 0:
            lagged = log_now
        x_piece = 0.0
        while x_piece < duration:
            t = t_piece + x_piece
            length = duration - x_piece
            if not whole_ramps:
                steepness = (abs(slope) + abs(transient) * model.led_rate) / now + leak
                steepness += model.cutoff * now * abs(log_now - lagged)
                length = min(length, max(CHANGE / steepness, MIN_STEP_US))
            if model.noise > 0:
                q = lagged + noise - reference + leak * (t - t_reference)
                if waiting or min(on - q, off + q) < CHANGE + FAR * model.noise:
                    length = min(length, NOISE_STEP / (model.cutoff * now))
            is_last = length == duration - x_piece
            x_piece = duration if is_last else x_piece + length

            # The path of v and noise over the step
            after = transient * np.exp(-model.led_rate * length)
            then = begin - lag + slope * x_piece + after
            log_then = np.log(then)
            noise_then = noise
            if model.noise > 0:
                own_time = model.cutoff * length * 0.5 * (now + then)
                if spare_is_left:
                    normal = spare
                else:
                    state, normal, spare = _draw_normals(state)
                spare_is_left = not spare_is_left
                kept = np.exp(-own_time)
                noise_then = kept * noise + model.noise * np.sqrt(1 - kept * kept) * normal
            step = _Step(
                length, now - transient, slope, transient, model.led_rate, model.cutoff,
                now, then - now, log_now, log_then - log_now, lagged, noise, noise_then - noise,
            )  # fmt: skip
            value_then = _log_intensity(length, step)

            # Its crossings
            x, value = 0.0, lagged + noise
            while True:
                if waiting:
                    if ready >= t + length:
                        break
                    x = max(ready - t, x)
                    value = _log_intensity(x, step)
                    reference, t_reference, waiting = value, t + x, False
                drifted = reference - leak * (t - t_reference)  # the reference at x = 0
                low, high = value + leak * x - drifted, value_then + leak * length - drifted
                sign = 1 if low >= on or high >= on else -1
                threshold = on if sign > 0 else -off
                if sign < 0 and low > -off and high > -off:
                    break
                if sign * low < sign * threshold:
                    if whole_ramps:
                        x = min(max((np.exp(drifted + threshold) - now) / slope, x), length)
                    else:
                        x = _find_crossing(x, length, low - threshold, high - threshold, drifted + threshold, leak, step)
                if n_event < len(t_us):
                    t_us[n_event] = t + x
                    polarity[n_event] = sign
                n_event += 1
                waiting, ready = True, t + x + model.refractory_us
                state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)

            lagged, noise = value_then - noise_then, noise_then
            now, log_now, transient = then, log_then, after
        glow = now
    return n_event


@njit(cache=True, error_model="numpy")
def _log_intensity(x, step):
    """Give v + noise at x of a step."""
    if step.cutoff == 0:
        return np.log(step.flat + step.slope * x + step.transient * np.exp(-step.led_rate * x))
    part = x / step.length
    own_time = step.cutoff * x * (step.light + 0.5 * step.light_gain * part)
    whole_time = step.cutoff * step.length * (step.light + 0.5 * step.light_gain)
    gone = -np.expm1(-own_time)
    lagged = step.lagged + (step.log_light - step.lagged) * gone + step.log_gain * (own_time - gone) / whole_time
    return lagged + step.noise + step.noise_gain * part


@njit(cache=True, error_model="numpy")
def _find_crossing(x_low, x_high, f_low, f_high, target, leak, step):
    """Find x where v + noise + leak x = target, by the Illinois method; f_low and f_high have unlike signs."""
    x = x_high
    side = 0
    for _ in range(100):
        x = (x_low * f_high - x_high * f_low) / (f_high - f_low)
        f = _log_intensity(x, step) + leak * x - target
        if abs(f) < CROSSING_TOLERANCE:
            break
        if (f > 0) == (f_high > 0):
            x_high, f_high = x, f
            if side == 1:
                f_low *= 0.5
            side = 1
        else:
            x_low, f_low = x, f
            if side == -1:
                f_high *= 0.5
            side = -1
    return x


# ---- random numbers: splitmix64 (Steele et al. 2014), one stream per pixel, and Box-Muller --------------


@njit(cache=True)
def _draw_uniform(state):
    """Give the next state and a number in (0, 1)."""
    state += np.uint64(0x9E3779B97F4A7C15)
    z = state
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return state, (np.float64(z >> np.uint64(11)) + 0.5) * 2.0**-53


@njit(cache=True)
def _draw_normals(state):
    """Give the next state and two independent normal deviates."""
    state, u = _draw_uniform(state)
    state, turn = _draw_uniform(state)
    radius = np.sqrt(-2 * np.log(u))
    return state, radius * np.cos(2 * np.pi * turn), radius * np.sin(2 * np.pi * turn)


@njit(cache=True)
def _draw_thresholds(state, threshold_on, threshold_off, event_noise):
    """Give the next state and the thresholds in force until the next event."""
    if event_noise == 0:
        return state, np.float64(threshold_on), np.float64(threshold_off)
    state, first, second = _draw_normals(state)
    on = max(threshold_on * (1 + event_noise * first), SMALLEST_THRESHOLD)
    off = max(threshold_off * (1 + event_noise * second), SMALLEST_THRESHOLD)
    return state, on, off
