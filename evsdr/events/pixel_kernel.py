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

Time goes in steps in which log I changes by about CHANGE. Within a step the slope of log I is a parabola in the
photoreceptor's own time, integral dt / tau, to which log I - v answers in closed form. The noise takes exact Ornstein-Uhlenbeck steps of at most
NOISE_STEP in that time, and is linear inside (a second pole would do the same), where it can reach a threshold; beyond
its reach it is drawn when it counts again. Crossings within a step are found to rounding error, also those of a v that
turns there. Without photoreceptor log I is exact at any time; without rise time too, a step is a whole ramp, and
without leak its crossing a closed form.
"""

from math import exp, factorial
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from evsdr.events.pixel import SMALLEST_THRESHOLD

CHANGE = 0.1  # of log intensity in a step: a cubic is within 1.3e-5 (derived: an eighth of its fourth power)
LED_CHANGE = (
    48**0.25 * CHANGE
)  # of an LED's rise time if its own change is all of I; derived: within the same
MIN_STEP_US = 1e-3
NOISE_STEP = 0.5
KEPT = exp(-NOISE_STEP)
EXPONENTIAL = tuple(1 / factorial(k) for k in range(9, -1, -1))
PLAIN = 0.05  # own time from which 1 - exp is right to 1e-14, which is enough; derived
FAR = 4.5  # standard deviations of the noise that are out of its reach: it is there once in 150,000 of its steps
LITTLE = 1e-6  # of log intensity, by which a turning point may be missed; guessed
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
    """A step of `length` us: I(x) = flat + slope x + transient exp(-led_rate x), and behind the photoreceptor, in own
    time s, log I has the slope first + s (second + s third)."""

    length: float
    flat: float
    slope: float
    transient: float
    led_rate: float
    cutoff: float
    late: float  # log I - v at x = 0
    first: float
    second: float
    third: float


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
    whole_ramps = model.cutoff == 0 and model.led_rate == 0
    n_slot = len(light) - 1
    n_event = 0
    state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)
    noise, stale, spare = 0.0, np.inf, np.nan  # how long ago in own time it was that; a deviate not used yet
    reach = FAR * model.noise
    noise_length = NOISE_STEP / model.cutoff if model.cutoff > 0 else 0.0
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
        per_now = 1 / now
        if model.cutoff == 0:
            lagged = log_now
        x_piece = 0.0
        while x_piece < duration:
            t = t_piece + x_piece
            length = duration - x_piece
            is_last = True
            if not whole_ramps:
                steepness = (abs(slope) + abs(transient) * model.led_rate) * per_now + leak
                longest = CHANGE / steepness
                if model.led_rate > 0:
                    longest = min(longest, LED_CHANGE * model.led_rise_us * (now / abs(transient)) ** 0.25)
                longest = max(longest, MIN_STEP_US)
                is_last = longest >= length
                length = min(length, longest)
            x_piece = duration if is_last else x_piece + length
            after = transient * np.exp(-model.led_rate * length) if model.led_rate > 0 else 0.0
            then = begin - lag + slope * x_piece + after
            log_then, per_then = (np.log(then), 1 / then) if then != now else (log_now, per_now)
            step = _Step(
                length, now - transient, slope, transient, model.led_rate, model.cutoff,
                log_now - lagged, 0.0, 0.0, 0.0,
            )  # fmt: skip
            growth = (slope - transient * model.led_rate) * per_now
            growth_then = (slope - after * model.led_rate) * per_then
            rate, fastest = growth, 0.0
            if model.cutoff > 0:
                step = _with_slopes(step, growth * per_now, growth_then * per_then, log_then - log_now)
                rate = model.cutoff * now * step.late
                fastest = max(abs(rate), abs(growth), abs(growth_then))
                fastest = fastest * max(now * per_then, then * per_now) + leak

            # From one time to look at to the next
            x, here = 0.0, _Moment(0.0, 1.0, now, lagged, rate)
            while x < length:
                if waiting and ready - t <= x:
                    if stale > 0 and model.noise > 0:
                        state, noise, spare = _draw_noise(state, spare, noise, model.noise, np.exp(-stale))
                        stale = 0.0
                    reference, t_reference, waiting = here.value + noise, t + x, False
                goal, noisy = length, False
                if waiting:
                    goal = min(ready - t, length)
                elif model.noise > 0:
                    q = here.value - reference + leak * (t + x - t_reference)
                    free = (min(on - q, off + q) - reach) / fastest
                    shortest = noise_length / here.light
                    noisy = not free > shortest
                    goal = min(x + (shortest if noisy else free), length)
                if waiting or (model.noise > 0 and not noisy):
                    there = _look(goal, step)
                    stale += there.own_time - here.own_time
                    x, here = goal, there
                    continue

                # With crossings
                noise_then = noise
                if noisy:
                    if stale > 0:
                        state, noise, spare = _draw_noise(state, spare, noise, model.noise, np.exp(-stale))
                        stale = 0.0
                    passed = _own_time(goal, step) - here.own_time
                    kept = _kept_in_noise_step(passed)
                    there = _look_after(goal, here.own_time + passed, 1 - here.kept * kept, step)
                    state, noise_then, spare = _draw_noise(state, spare, noise, model.noise, kept)
                else:
                    there = _look(goal, step)
                if (
                    not noisy and (here.rate + leak) * (there.rate + leak) < 0
                ):  # v turns, maybe beyond a threshold
                    q = here.value - reference + leak * (t + x - t_reference)
                    part = (here.rate + leak) / (here.rate - there.rate)
                    beyond = q + (here.rate + leak) * (goal - x)
                    if not -off < beyond < on and abs(here.rate + leak) * (goal - x) > LITTLE:
                        goal = x + max(part, 0.01) * (goal - x)
                        there = _look(goal, step)
                tilt = (noise_then - noise) / (goal - x) if noisy else 0.0
                base = noise - tilt * x  # noise is base + tilt x
                value, value_then = here.value + noise, there.value + noise_then
                while True:
                    if waiting:
                        if ready - t >= goal:
                            break
                        x = max(ready - t, x)
                        value = _look(x, step).value + base + tilt * x
                        reference, t_reference, waiting = value, t + x, False
                    drifted = reference - leak * (t - t_reference)  # the reference at x = 0
                    low, high = value + leak * x - drifted, value_then + leak * goal - drifted
                    at_once = low >= on or low <= -off
                    q = low if at_once else high
                    if -off < q < on:
                        break
                    sign, threshold = (1, on) if q > 0 else (-1, -off)
                    if not at_once:
                        target = drifted + threshold
                        if whole_ramps and leak == 0:
                            x = min(max((np.exp(target) - now) / slope, x), goal)
                        else:
                            x = _find_crossing(
                                x, goal, low - threshold, high - threshold, target - base, leak + tilt, step
                            )
                    if n_event < len(t_us):
                        t_us[n_event] = t + x
                        polarity[n_event] = sign
                    n_event += 1
                    waiting, ready = True, t + x + model.refractory_us
                    state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)
                x, here, noise = goal, there, noise_then

            lagged = here.value
            now, per_now, log_now, transient = then, per_then, log_then, after
        glow = now
    return n_event


class _Moment(NamedTuple):
    """What is so at x of a step."""

    own_time: float
    kept: float  # exp(-own_time)
    light: float
    value: float  # v
    rate: float  # dv/dx


@njit(cache=True, error_model="numpy")
def _with_slopes(step, growth, growth_then, change):
    """Give a step with its slopes of log I: right are I' / I^2 at both ends [1/us] and the change of log I."""
    tau, per_own_time = 1 / step.cutoff, 1 / _own_time(step.length, step)
    first, bend = growth * tau, (growth_then - growth) * tau
    rest = change * per_own_time - first
    second, third = 2 * (3 * rest - bend) * per_own_time, 3 * (bend - 2 * rest) * per_own_time * per_own_time
    return _Step(
        step.length, step.flat, step.slope, step.transient, step.led_rate, step.cutoff,
        step.late, first, second, third,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _own_time(x, step):
    own_time = step.cutoff * x * (step.flat + 0.5 * step.slope * x)
    if step.led_rate > 0:
        own_time -= step.cutoff * step.transient * np.expm1(-step.led_rate * x) / step.led_rate
    return own_time


@njit(cache=True)
def _gone(own_time):
    """Give 1 - exp(-own_time), to rounding error; `expm1` takes longer where it is not needed."""
    return 1 - np.exp(-own_time) if own_time > PLAIN else -np.expm1(-own_time)


@njit(cache=True)
def _kept_in_noise_step(own_time):
    """Give exp(-own_time), quicker near NOISE_STEP: to rounding, as the next term would add 1e-17."""
    more = NOISE_STEP - own_time
    if abs(more) > 0.06:
        return np.exp(-own_time)
    total = 0.0
    for coefficient in EXPONENTIAL:
        total = coefficient + more * total
    return KEPT * total


@njit(cache=True, error_model="numpy")
def _look(x, step):
    """Give the `_Moment` at x of a step."""
    if step.cutoff == 0:
        return _look_after(x, 0.0, 0.0, step)
    own_time = _own_time(x, step)
    return _look_after(x, own_time, _gone(own_time), step)


@njit(cache=True, error_model="numpy")
def _look_after(x, s, gone, step):
    """Give the `_Moment` at x of a step, where its own time is s and 1 - exp(-s) is gone."""
    light, rise = step.flat + step.slope * x, step.slope
    if step.led_rate > 0:
        after = step.transient * np.exp(-step.led_rate * x)
        light, rise = light + after, rise - step.led_rate * after
    if step.cutoff == 0:
        return _Moment(0.0, 1.0, light, np.log(light), rise / light)
    one = s - gone  # beside gone: integrals of 1, s and s^2 times exp(-own time since), times 1, 1 and 2
    two = s * s - 2 * one
    late = step.late * (1 - gone) + step.first * gone + step.second * one + step.third * two
    return _Moment(s, 1 - gone, light, np.log(light) - late, step.cutoff * light * late)


@njit(cache=True, error_model="numpy")
def _find_crossing(x_low, x_high, f_low, f_high, target, leak, step):
    """Find x where v + leak x = target by Newton's method between two x; f_low and f_high differ in sign."""
    x = (x_low * f_high - x_high * f_low) / (f_high - f_low)
    for _ in range(100):
        here = _look(x, step)
        f = here.value + leak * x - target
        if abs(f) < CROSSING_TOLERANCE:
            break
        if (f > 0) == (f_high > 0):
            x_high = x
        else:
            x_low = x
        x -= f / (here.rate + leak)
        if not x_low < x < x_high:
            x = 0.5 * (x_low + x_high)
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
def _draw_noise(state, spare, noise, sigma, kept):
    """Give the next state, the noise when a share of it is kept, and a deviate to spare, or nan."""
    normal, left = spare, np.nan
    if np.isnan(spare):
        state, normal, left = _draw_normals(state)
    return state, kept * noise + sigma * np.sqrt(1 - kept * kept) * normal, left


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
