"""How one event pixel turns the ring's light into events, at exact times.

The light I(t) follows the schedule (see `phase`), each LED behind its own rise time. The pixel obeys

    tau dv/dt = log I - v,     1 / tau = 2 pi cutoff I          photoreceptor, slower in the dark
    q(t) = v + noise - reference + leak (t - t_ref)             what the comparators see

and fires at q = +C_on or q = -C_off. When the refractory period is over, the reference is memorised anew,
and the leak starts again at t_ref. Without photoreceptor v = log I; a hard switch of the light is then a
jump that fires once.

The noise is the shot noise of photo-electrons, white in log I with density 1 / (photon_rate I), behind the
photoreceptor. Density and bandwidth both follow I, so its variance pi cutoff / photon_rate is the same in all
light.

Time goes in steps in which log I, v and leak together change by at most CHANGE. Within a step log I is a
parabola in the photoreceptor's own time, integral dt / tau, to which v answers in closed form. The noise
takes exact Ornstein-Uhlenbeck steps of at most NOISE_STEP in that time, and is linear inside (a second pole
would do the same); where it can't reach a threshold the steps are longer. Crossings within a step are found
to rounding error. Without photoreceptor log I is exact at any time; without leak and rise time too, a step
is a whole ramp and its crossing a closed form.
"""

from math import factorial
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from evsdr.events.pixel import SMALLEST_THRESHOLD

CHANGE = 0.05  # of log intensity in a step
MIN_STEP_US = 1e-3
NOISE_STEP = 0.5
FAR = 6.0  # standard deviations of the noise that are out of its reach
CROSSING_TOLERANCE = 1e-12  # of log intensity
# Coefficients of sine and cosine, the last first; derived: the next would add 1e-17 at an eighth of a turn
TAYLOR = tuple((1 / factorial(2 * k + 1), 1 / factorial(2 * k)) for k in range(8, -1, -1))


class Model(NamedTuple):
    """What all pixels share; times in us, rates in 1/us."""

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
    own_time: float
    log_light: float
    log_light_then: float
    bend: float
    lagged: float  # v at x = 0
    noise: float
    noise_then: float


@njit(cache=True, parallel=True)
def run_pixels(light, threshold_on, threshold_off, leak, state, model, t_us, polarity, count):
    """Run some pixels.

    Parameters
    ----------
    light : (n_pixel, n_slot + 1) float64
        I with each slot's LED fully lit, the first again after the last; above 0.
    threshold_on, threshold_off : (n_pixel,) float32
        Contrast thresholds.
    leak : (n_pixel,) float64
        Drift of the reference [1/us].
    state : (n_pixel,) uint64
        Where the random numbers of each pixel start; they depend on nothing else.
    model : Model
        What all pixels share.
    t_us, polarity : (n_pixel, room) float64 and int8
        Written: times since the start [us] and +1 or -1, as far as there is room.
    count : (n_pixel,) int64
        Written: numbers of events, more than `room` where that was too little.
    """
    for i in prange(len(light)):
        count[i] = _run_pixel(
            light[i], threshold_on[i], threshold_off[i], leak[i], state[i], model, t_us[i], polarity[i]
        )


@njit(cache=True, error_model="numpy")
def _run_pixel(light, threshold_on, threshold_off, leak, state, model, t_us, polarity):
    """Run one pixel; give its number of events."""
    whole_ramps = model.cutoff == 0 and model.led_rate == 0 and leak == 0
    n_slot = len(light) - 1
    n_event = 0
    state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)
    state, normal, spare = _draw_normals(state)
    noise, spare_is_left = model.noise * normal, True
    glow, lagged = light[0], np.log(light[0])  # the LEDs' settled light, and v
    reference, t_reference = 0.0, 0.0
    noise_length = NOISE_STEP / model.cutoff if model.cutoff > 0 else 0.0
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
        per_now = 1 / now
        if model.cutoff == 0:
            lagged = log_now
        x_piece = 0.0
        while x_piece < duration:
            t = t_piece + x_piece
            length = duration - x_piece
            if not whole_ramps:
                steepness = (abs(slope) + abs(transient) * model.led_rate) * per_now + leak
                steepness += model.cutoff * now * abs(log_now - lagged)
                length = min(length, max(CHANGE / steepness, MIN_STEP_US))
            if model.noise > 0:
                q = lagged + noise - reference + leak * (t - t_reference)
                if waiting or min(on - q, off + q) < CHANGE + FAR * model.noise:
                    length = min(length, noise_length * per_now)
            is_last = length == duration - x_piece
            x_piece = duration if is_last else x_piece + length

            # The path of v and noise over the step
            after = transient * np.exp(-model.led_rate * length) if model.led_rate > 0 else 0.0
            then = begin - lag + slope * x_piece + after
            log_then = np.log(then) if then != now else log_now
            own_time = model.cutoff * (0.5 * length * (now - transient + then - after))
            own_time += model.cutoff * model.led_rise_us * (transient - after)
            gone = _gone(own_time)
            per_then = 1 / then
            lagged_then, noise_then, bend = log_then, noise, 0.0
            if model.cutoff > 0:
                growth = (slope - transient * model.led_rate) * per_now * per_now
                growth_then = (slope - after * model.led_rate) * per_then * per_then
                bend = 0.5 * (growth_then - growth) / (model.cutoff * own_time)
                lagged_then = _lag(lagged, log_now, log_then, bend, own_time, own_time, gone)
            if model.noise > 0:
                if spare_is_left:
                    normal = spare
                else:
                    state, normal, spare = _draw_normals(state)
                spare_is_left = not spare_is_left
                noise_then = (1 - gone) * noise + model.noise * np.sqrt(gone * (2 - gone)) * normal
            step = _Step(
                length, now - transient, slope, transient, model.led_rate, model.cutoff,
                own_time, log_now, log_then, bend, lagged, noise, noise_then,
            )  # fmt: skip

            # Its crossings
            x, value, value_then = 0.0, lagged + noise, lagged_then + noise_then
            while True:
                if waiting:
                    if ready >= t + length:
                        break
                    x = max(ready - t, x)
                    value = _log_intensity(x, step)
                    reference, t_reference, waiting = value, t + x, False
                drifted = reference - leak * (t - t_reference)  # the reference at x = 0
                low, high = value + leak * x - drifted, value_then + leak * length - drifted
                at_once = low >= on or low <= -off
                q = low if at_once else high
                if -off < q < on:
                    break
                sign, threshold = (1, on) if q > 0 else (-1, -off)
                if not at_once:
                    low, high, target = low - threshold, high - threshold, drifted + threshold
                    if whole_ramps:
                        x = min(max((np.exp(target) - now) / slope, x), length)
                    else:
                        x = _find_crossing(x, length, low, high, target, leak, step)
                if n_event < len(t_us):
                    t_us[n_event] = t + x
                    polarity[n_event] = sign
                n_event += 1
                waiting, ready = True, t + x + model.refractory_us
                state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)

            lagged, noise = lagged_then, noise_then
            now, per_now, log_now, transient = then, per_then, log_then, after
        glow = now
    return n_event


@njit(cache=True)
def _gone(own_time):
    """Give 1 - exp(-own_time), to rounding error; `expm1` takes longer where it is not needed."""
    return 1 - np.exp(-own_time) if own_time > 0.3 else -np.expm1(-own_time)


@njit(cache=True)
def _lag(lagged, log_light, log_light_then, bend, own_time, whole_time, gone):
    """Give v at own_time, while log I goes from log_light to log_light_then in whole_time.

    `bend` is half the second derivative of log I, `gone` is 1 - exp(-own_time).
    """
    change = (log_light_then - log_light) / whole_time
    behind = own_time - gone
    even = lagged + (log_light - lagged) * gone + change * behind
    return even + bend * (own_time * own_time - (whole_time + 2) * behind)


@njit(cache=True, error_model="numpy")
def _log_intensity(x, step):
    """Give v + noise at x of a step."""
    if step.cutoff == 0:
        return np.log(step.flat + step.slope * x + step.transient * np.exp(-step.led_rate * x))
    own_time = step.cutoff * x * (step.flat + 0.5 * step.slope * x)
    if step.led_rate > 0:
        own_time -= step.cutoff * step.transient * np.expm1(-step.led_rate * x) / step.led_rate
    gone = _gone(own_time)
    lagged = _lag(step.lagged, step.log_light, step.log_light_then, step.bend, own_time, step.own_time, gone)
    return lagged + step.noise + (step.noise_then - step.noise) * (x / step.length)


@njit(cache=True, error_model="numpy")
def _find_crossing(x_low, x_high, f_low, f_high, target, leak, step):
    """Find x where v + noise + leak x = target by the Illinois method; f_low and f_high differ in sign."""
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
    cosine, sine = _on_circle(turn)
    return state, radius * cosine, radius * sine


@njit(cache=True)
def _on_circle(turn):
    """Give cosine and sine of a share of a turn, 0 to 1, to rounding error: Taylor's series within an eighth of one."""
    quarter = np.floor(4 * turn + 0.5)
    angle = 2 * np.pi * (turn - 0.25 * quarter)
    square = angle * angle
    sine, cosine = 0.0, 0.0
    for odd, even in TAYLOR:
        sine, cosine = odd - square * sine, even - square * cosine
    sine *= angle
    k = int(quarter) & 3
    if k & 1:
        sine, cosine = cosine, -sine
    return (-cosine, -sine) if k & 2 else (cosine, sine)


@njit(cache=True)
def _draw_thresholds(state, threshold_on, threshold_off, event_noise):
    """Give the next state and the thresholds in force until the next event."""
    if event_noise == 0:
        return state, np.float64(threshold_on), np.float64(threshold_off)
    state, first, second = _draw_normals(state)
    on = max(threshold_on * (1 + event_noise * first), SMALLEST_THRESHOLD)
    off = max(threshold_off * (1 + event_noise * second), SMALLEST_THRESHOLD)
    return state, on, off
