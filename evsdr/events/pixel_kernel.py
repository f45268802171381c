"""How one event pixel turns the ring's light into events, at exact times.

The light I(t) follows the schedule (see `phase`), each LED behind its own rise time. The pixel obeys

    tau dv/dt = log I - v,     1 / tau = 2 pi cutoff I          photoreceptor, slower in the dark
    q(t) = v + noise - reference + leak (t - t_ref)             what the comparators see

and fires at q = +C_on or q = -C_off. When the refractory period is over, the reference is memorised anew,
and the leak starts again at t_ref. Without photoreceptor v = log I; a hard switch of the light is then a
jump that fires once.

All is reckoned in the photoreceptor's own time s, ds = dt / tau (without one, in t). With the lateness log I - v

    dv/ds = lateness,     d lateness/ds = growth - lateness,     growth = dlog I/ds = 1 / (2 (c + s)) for light that fades evenly.

Growth is a polynomial over a segment, in which log I changes by at most CHANGE; the lateness is then another
polynomial and an exponential. It stays within the range of what it was and of the growth, so v has bounds at
every later time: what they keep within the thresholds is passed over, else halves are searched until v goes one
way, where the end tells whether a threshold was crossed. So none is lost, not even where v touches one and turns.

The noise is the shot noise of photo-electrons, white in log I with density 1 / (photon_rate I), behind the
photoreceptor. Density and bandwidth both follow I, so its variance pi cutoff / photon_rate is the same in all
light. It is an exact Ornstein-Uhlenbeck process every NOISE_STEP of own time, linear between (a second pole would
do the same), and is drawn only where it can reach a threshold, or is memorised.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from evsdr.events.draws import draw_normal
from evsdr.events.pixel import SMALLEST_THRESHOLD
from evsdr.events.segment import (
    N_TERM,
    bounds,
    free_time,
    late_after,
    length_of_segment,
    look,
    new_segment,
    next_crossing,
    own_time,
    x_at,
)

NOISE_STEP = 0.5
FAR = 5.0  # standard deviations of the noise that are out of its reach, at 1 in 3 million of its steps
OFTEN = 7.75  # own time after which the bounds are drawn anew; between two steps of noise, so that rounding decides nothing
# Of the noise after so many of its steps: what is left, and what has come; after the last of them 1e-17 is left
KEPT = np.exp(-NOISE_STEP * np.arange(80))
FRESH = np.sqrt(1 - KEPT**2)


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
        on, off = threshold_on[i], threshold_off[i]
        if model.cutoff == 0 and model.led_rate == 0 and leak[i] == 0:
            count[i] = _run_bare_pixel(light[i], on, off, state[i], model, t_us[i], polarity[i])
        else:
            count[i] = _run_pixel(light[i], on, off, leak[i], state[i], model, t_us[i], polarity[i])


@njit(cache=True)
def gather(todo, start, count, t_us, polarity, pixel_out, polarity_out, t_us_out):
    """Write the events of the pixels that had room, those of each from its start on."""
    for i in range(len(todo)):
        if count[i] <= t_us.shape[1]:
            for k in range(count[i]):
                n = start[i] + k
                pixel_out[n], t_us_out[n], polarity_out[n] = todo[i], t_us[i, k], polarity[i, k]


@njit(cache=True)
def _when(piece, model):
    """Give slot, whether it fades, start and duration of a piece of it, of which light is still in the first."""
    k, fading = divmod(piece, 2)
    duration = model.slot_us * (model.crossfade if fading else 1 - model.crossfade)
    return k, fading, k * model.slot_us + fading * (model.slot_us - duration), duration


@njit(cache=True, error_model="numpy")
def _run_bare_pixel(light, threshold_on, threshold_off, state, model, t_us, polarity):
    """Run one pixel with v = log I and no leak, while LEDs rise at once; give its number of events.

    Light then goes one way, evenly, and crosses levels where it is their exponential.
    """
    n_slot, n_event, logs = len(light) - 1, 0, np.log(light)
    state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)
    state, _ = draw_normal(state)  # thresholds are those of a pixel with a leak
    reference, waiting, ready = 0.0, True, 0.0
    for piece in range(2 * n_slot * model.n_round):
        k, fading, t_piece, duration = _when(piece, model)
        if duration <= 0:
            continue
        k %= n_slot
        slope = (light[k + fading] - light[k]) / duration
        x, v, v_end = 0.0, logs[k], logs[k + fading]
        while True:
            if waiting:
                if ready >= t_piece + duration:
                    break
                if ready > t_piece:
                    x = ready - t_piece
                    v = np.log(light[k] + slope * x)
                reference, waiting = v, False
            if max(v, v_end) >= reference + on:
                sign, level = 1, reference + on
            elif min(v, v_end) <= reference - off:
                sign, level = -1, reference - off
            else:
                break
            if sign * (level - v) > 0:  # else light has jumped
                x = min(max((np.exp(level) - light[k]) / slope, x), duration)
            if n_event < len(t_us):
                t_us[n_event] = t_piece + x
                polarity[n_event] = sign
            n_event += 1
            waiting, ready = True, t_piece + x + model.refractory_us
            state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)
    return n_event


@njit(cache=True, error_model="numpy")
def _run_pixel(light, threshold_on, threshold_off, leak, state, model, t_us, polarity):
    """Run one pixel; give its number of events."""
    n_slot = len(light) - 1
    n_event = 0
    reach = FAR * model.noise
    poly, logs = np.zeros(N_TERM + 1), np.log(light)
    state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)
    state, normal = draw_normal(state)
    noise = noise_then = model.noise * normal  # NOISE_STEP before, and at
    node = 0.0  # in own time from where the segment starts
    glow, lagged = light[0], np.log(light[0])  # the LEDs' settled light, and v
    reference, t_reference = 0.0, 0.0
    waiting, ready = True, 0.0  # for the end of the refractory period

    for piece in range(2 * n_slot * model.n_round):
        k, fading, t_piece, duration = _when(piece, model)
        if duration <= 0:
            continue
        begin, end = light[k % n_slot], light[k % n_slot + fading]
        slope = (end - begin) / duration
        lag = slope * model.led_rise_us
        transient = glow - begin + lag if model.led_rate > 0 else 0.0
        now = begin - lag + transient
        log_now = np.log(now) if model.led_rate > 0 else logs[k % n_slot]
        log_end = logs[k % n_slot + fading]
        late = log_now - lagged if model.cutoff > 0 else 0.0
        lagged = log_now - late
        x_piece = 0.0
        if model.led_rate == 0 and (
            ready >= t_piece + duration
            if waiting
            else _keeps_within(
                log_end,
                log_now,
                lagged,
                leak * (t_piece + duration - t_reference),
                on - reach,
                off - reach,
                reference,
            )
        ):
            span = 0.5 * model.cutoff * duration * (now + end)
            late_then = late_after(span, late, slope, end, model.cutoff)
            if not np.isnan(late_then):
                node -= span
                lagged = log_end - late_then
                continue
        while x_piece < duration:
            t = t_piece + x_piece
            length = length_of_segment(now, slope, transient, duration - x_piece, model)
            is_last = length == duration - x_piece
            x_piece = duration if is_last else x_piece + length
            after = transient * np.exp(-model.led_rate * length) if model.led_rate > 0 else 0.0
            then = begin - lag + slope * x_piece + after
            log_then = np.log(then) if not is_last or model.led_rate > 0 else log_end
            segment = new_segment(length, now, slope, transient, log_now - late, late, model, poly)
            span, v_then = segment.span, segment.then if model.cutoff > 0 else log_then
            drift = (
                leak / (model.cutoff * min(now, then)) if model.cutoff > 0 else leak
            )  # per own time, at most
            s, x, v, rate = 0.0, 0.0, log_now - late, late
            level = reference - leak * (t - t_reference)
            while True:
                if waiting:
                    if ready >= t + length:
                        break
                    x = max(ready - t, x)
                    s = min(max(own_time(x, segment), s), span)
                    state, node, noise, noise_then = _noise_until(
                        s, state, node, noise, noise_then, model.noise
                    )
                elif s > 0:
                    x = x_at(s, segment)
                if s > 0:
                    v, rate = look(s, segment, poly)
                if waiting:
                    reference = v + _noise_at(s, node, noise, noise_then)
                    t_reference, waiting = t + x, False
                    level = reference + leak * x
                ahead = span - s
                up = level + on - v - leak * x
                down = on + off - up
                up_then = level + on - v_then - leak * length
                down_then = on + off - up_then
                slowest, fastest = bounds(s, span, rate, drift, segment)
                free = min(
                    free_time(up - reach, up_then - reach, slowest, fastest, ahead),
                    free_time(down - reach, down_then - reach, -fastest, -slowest, ahead),
                )
                if free >= ahead:
                    break
                stop, tilt, here = span, 0.0, 0.0
                if model.noise > 0:
                    if free > 2 * NOISE_STEP:
                        s += free
                        continue
                    state, node, noise, noise_then = _noise_until(
                        s, state, node, noise, noise_then, model.noise
                    )
                    first, here = s, _noise_at(s, node, noise, noise_then)
                    while True:
                        stop = min(node, span)
                        there = noise_then if node <= span else _noise_at(span, node, noise, noise_then)
                        ahead = stop - first
                        if there >= up - fastest * ahead or there <= -down - slowest * ahead or here >= up:
                            break
                        s, here = stop, there
                        if s == span or ahead > OFTEN:
                            break
                        state, normal = draw_normal(state)
                        noise, node = noise_then, node + NOISE_STEP
                        noise_then = KEPT[1] * noise + FRESH[1] * model.noise * normal
                    if s == stop:
                        if s == span:
                            break
                        continue
                    tilt = (noise_then - noise) / NOISE_STEP
                    if s > first:
                        x, (v, rate) = x_at(s, segment), look(s, segment, poly)
                s, x, sign = next_crossing(
                    s,
                    x,
                    stop,
                    v + leak * x,
                    rate,
                    level - off,
                    level + on,
                    here,
                    tilt,
                    leak,
                    drift,
                    segment,
                    poly,
                )
                if sign == 0:
                    if s == span:
                        break
                    continue
                t_event = t + x
                if n_event < len(t_us):
                    t_us[n_event] = t_event
                    polarity[n_event] = sign
                n_event += 1
                waiting, ready = True, t_event + model.refractory_us
                state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)

            if model.cutoff > 0:
                node -= span
            late = segment.late_then
            now, log_now, transient = then, log_then, after
        glow, lagged = now, log_now - late
    return n_event


@njit(cache=True)
def _keeps_within(log_then, log_now, lagged, drift, on, off, reference):
    """Tell whether v, which follows log I, keeps within thresholds while light goes one way."""
    low = min(min(log_now, log_then), lagged) - reference
    high = max(max(log_now, log_then), lagged) - reference + drift
    return low > -off and high < on


@njit(cache=True, error_model="numpy")
def _noise_until(s, state, node, noise, noise_then, sigma):
    """Draw the noise until s lies between its nodes: before the last one, and not before that before."""
    if sigma == 0 or node > s:
        return state, node, noise, noise_then
    skipped = int((s - node) / NOISE_STEP)
    if skipped > 0:
        k = min(skipped, len(KEPT) - 1)
        state, normal = draw_normal(state)
        noise_then = KEPT[k] * noise_then + FRESH[k] * sigma * normal
        node += NOISE_STEP * skipped
    state, normal = draw_normal(state)
    return state, node + NOISE_STEP, noise_then, KEPT[1] * noise_then + FRESH[1] * sigma * normal


@njit(cache=True)
def _noise_at(s, node, noise, noise_then):
    return noise_then + (noise_then - noise) * (s - node) / NOISE_STEP


@njit(cache=True)
def _draw_thresholds(state, threshold_on, threshold_off, event_noise):
    """Give the next state and the thresholds in force until the next event."""
    if event_noise == 0:
        return state, np.float64(threshold_on), np.float64(threshold_off)
    state, first = draw_normal(state)
    state, second = draw_normal(state)
    on = max(threshold_on * (1 + event_noise * first), SMALLEST_THRESHOLD)
    off = max(threshold_off * (1 + event_noise * second), SMALLEST_THRESHOLD)
    return state, on, off
