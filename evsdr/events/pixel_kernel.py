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

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from evsdr.events.pixel import SMALLEST_THRESHOLD

CHANGE = 0.2  # of log intensity in a segment: tanh(CHANGE)^N_TERM / 16, 1e-7, is left of the growth's integral (derived)
N_TERM = 8  # of the growth
SHORT = 0.5  # own time below which the lateness is its power series; rounding leaves 1e-12 on both sides (derived)
OF_RISE = 0.5  # of an LED's rise time in a segment, as long as it still rises
RISEN = 1e-12  # of the light, that may be missing of an LED's
MIN_STEP_US = 1e-3
TINY = 1e-300
NOISE_STEP = 0.5
FAR = 5.0  # standard deviations of the noise that are out of its reach, at 1 in 3 million of its steps
OFTEN = 8.0  # own time after which the bounds are drawn anew
GRAZED = 1e-9  # of log intensity, by which v may turn beyond a threshold unseen
CROSSING_TOLERANCE = 1e-12  # of log intensity
LONG, ASYMPTOTIC = (
    40.0,
    1 / 32,
)  # own time after which nothing is left of what was, and of a term of the series (1e-7)
PER_ORDER = tuple(1 / k for k in range(1, N_TERM + 2))
KEPT = float(np.exp(-NOISE_STEP))
FRESH = float(np.sqrt(1 - KEPT**2))


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


class _Segment(NamedTuple):
    """I(x) = flat + slope x + transient exp(-led_rate x) for `length` us, `span` of own time s (x without photoreceptor).

    v(s) = base + integral of the polynomial from the middle - excess exp(-s).
    """

    length: float
    span: float
    flat: float
    slope: float
    transient: float
    led_rate: float
    cutoff: float
    base: float
    excess: float


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


@njit(cache=True)
def gather(todo, count, t_us, polarity, pixel_out, polarity_out, t_us_out):
    """Write the events of the pixels that had room one after the other."""
    n = 0
    for i in range(len(todo)):
        if count[i] <= t_us.shape[1]:
            for k in range(count[i]):
                pixel_out[n], t_us_out[n], polarity_out[n] = todo[i], t_us[i, k], polarity[i, k]
                n += 1


@njit(cache=True, error_model="numpy")
def _run_pixel(light, threshold_on, threshold_off, leak, state, model, t_us, polarity):
    """Run one pixel; give its number of events."""
    n_slot = len(light) - 1
    n_event = 0
    reach = FAR * model.noise
    poly, logs = np.zeros(N_TERM + 1), np.log(light)
    state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)
    state, normal = _draw_normal(state)
    noise = noise_then = model.noise * normal  # NOISE_STEP before, and at
    node = 0.0  # in own time from where the segment starts
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
            late_then = _late_after(span, late, slope, end, model.cutoff)
            if not np.isnan(late_then):
                node -= span
                lagged = log_end - late_then
                continue
        while x_piece < duration:
            t = t_piece + x_piece
            length = _length_of_segment(now, slope, transient, duration - x_piece, model)
            is_last = length == duration - x_piece
            x_piece = duration if is_last else x_piece + length
            after = transient * np.exp(-model.led_rate * length) if model.led_rate > 0 else 0.0
            then = begin - lag + slope * x_piece + after
            log_then = np.log(then) if not is_last or model.led_rate > 0 else log_end
            segment = _new_segment(length, now, slope, transient, log_now - late, late, model, poly)
            span, late_now = segment.span, late
            drift = (
                leak / (model.cutoff * min(now, then)) if model.cutoff > 0 else leak
            )  # per own time, at most
            s, level = 0.0, reference - leak * (t - t_reference)
            while True:
                if waiting:
                    if ready >= t + length:
                        break
                    s = min(max(_own_time(ready - t, segment), s), span)
                    state, node, noise, noise_then = _noise_until(
                        s, state, node, noise, noise_then, model.noise
                    )
                    lagged, _ = _look(s, segment, poly)
                    reference = lagged + _noise_at(s, node, noise, noise_then)
                    t_reference, waiting = max(ready, t), False
                    level = reference + leak * (t_reference - t)
                stop, tilt, here = span, 0.0, 0.0
                if model.led_rate == 0 and _keeps_within(
                    log_then,
                    log_now,
                    log_now - late_now,
                    leak * (t + length - t_reference),
                    on - reach,
                    off - reach,
                    reference,
                ):
                    break
                if model.noise > 0:
                    if s >= span:
                        break
                    lagged, late = _look(s, segment, poly)
                    up = level + on - lagged - leak * _x_at(s, segment)
                    down = on + off - up
                    slowest, fastest = _bounds(s, span, late, drift, segment)
                    if up > reach and down > reach:
                        free = min((up - reach) / max(fastest, TINY), (down - reach) / max(-slowest, TINY))
                        if free > 2 * NOISE_STEP:
                            s += free
                            if s >= span:
                                break
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
                        state, normal = _draw_normal(state)
                        noise, node = noise_then, node + NOISE_STEP
                        noise_then = KEPT * noise + FRESH * model.noise * normal
                    if s == stop:
                        if s == span:
                            break
                        continue
                    tilt = (noise_then - noise) / NOISE_STEP
                s, sign = _next_crossing(
                    s, stop, level - off, level + on, here, tilt, leak, drift, segment, poly
                )
                if sign == 0:
                    if s == span:
                        break
                    continue
                t_event = t + _x_at(s, segment)
                if n_event < len(t_us):
                    t_us[n_event] = t_event
                    polarity[n_event] = sign
                n_event += 1
                waiting, ready = True, t_event + model.refractory_us
                state, on, off = _draw_thresholds(state, threshold_on, threshold_off, model.event_noise)

            if model.cutoff > 0:
                _, late = _look(span, segment, poly)
                node -= span
            else:
                late = 0.0
            now, log_now, transient = then, log_then, after
        glow, lagged = now, log_now - late
    return n_event


# ---- light and photoreceptor ----------------------------------------------------------------------------


@njit(cache=True)
def _keeps_within(log_then, log_now, lagged, drift, on, off, reference):
    """Tell whether v, which follows log I, keeps within thresholds while light goes one way."""
    low = min(min(log_now, log_then), lagged) - reference
    high = max(max(log_now, log_then), lagged) - reference + drift
    return low > -off and high < on


@njit(cache=True, error_model="numpy")
def _late_after(span, late, slope, end, cutoff):
    """Give the lateness when an even fade to `end` is over, nan where its asymptotic series will not do."""
    if cutoff == 0:
        return 0.0
    if slope == 0:
        return late * np.exp(-span)
    growth = slope / (cutoff * end * end)
    if span < LONG or abs(growth) > 0.5 * ASYMPTOTIC:
        return np.nan
    late, term = 0.0, growth
    for k in range(1, N_TERM):
        late += term
        term *= 2 * growth * k
    return late


@njit(cache=True, error_model="numpy")
def _length_of_segment(now, slope, transient, rest, model):
    """Give how long growth is a polynomial [us]; light alone is exact as long as it goes one way."""
    rises = abs(transient) > RISEN * now
    if not rises and (slope == 0 or model.cutoff == 0):
        return rest
    steepness = abs(slope) + abs(transient) * model.led_rate
    length = (1 - np.exp(-CHANGE)) * now / steepness
    if rises:
        length = min(length, OF_RISE * model.led_rise_us)
    return min(max(length, MIN_STEP_US), rest)


@njit(cache=True, error_model="numpy")
def _new_segment(length, now, slope, transient, lagged, late, model, poly):
    """Give a segment that starts with this light, v and lateness, and write the polynomial of the lateness."""
    led_rate = model.led_rate if abs(transient) > RISEN * now else 0.0
    transient = transient if led_rate > 0 else 0.0
    flat = now - transient
    segment = _Segment(length, length, flat, slope, transient, led_rate, model.cutoff, 0.0, 0.0)
    if model.cutoff == 0:
        return segment
    span = _own_time(length, segment)
    middle = 0.5 * span
    if slope == 0 and transient == 0:
        poly[:] = 0
        return _Segment(length, span, flat, slope, transient, led_rate, model.cutoff, lagged + late, late)
    if transient == 0:
        bend = slope / (model.cutoff * now * now + slope * span)  # 1 / (2 c) in the middle
        poly[0] = bend
        for k in range(1, N_TERM):
            poly[k] = -2 * bend * poly[k - 1]
    else:
        _fit_growth(segment, middle, poly)
    if span < SHORT:
        before, poly[N_TERM] = 0.0, 0.0
        for k in range(N_TERM + 1):
            poly[k], before = before, (poly[k] - before) * PER_ORDER[k]
    else:
        poly[N_TERM] = 0.0
        for k in range(N_TERM - 2, -1, -1):
            poly[k] -= (k + 1) * poly[k + 1]
    integral, value = _sums(-middle, poly)
    excess = late - value
    return _Segment(
        length, span, flat, slope, transient, led_rate, model.cutoff, lagged - integral + excess, excess
    )


@njit(cache=True, error_model="numpy")
def _fit_growth(segment, middle, poly):
    """Write the polynomial about the middle through the growth at N_TERM times (Newton's)."""
    at, last = np.empty(N_TERM), N_TERM - 1
    newton = np.empty(N_TERM)
    for j in range(N_TERM):
        x = segment.length * 0.5 * (1 - np.cos(np.pi * (j + 0.5) / N_TERM))
        at[j], newton[j] = _own_time(x, segment) - middle, _growth_at(x, segment)
    for order in range(1, N_TERM):
        for j in range(last, order - 1, -1):
            newton[j] = (newton[j] - newton[j - 1]) / (at[j] - at[j - order])
    poly[:] = 0
    for j in range(last, -1, -1):
        for k in range(last, 0, -1):
            poly[k] = poly[k - 1] - at[j] * poly[k]
        poly[0] = newton[j] - at[j] * poly[0]


@njit(cache=True, error_model="numpy")
def _own_time(x, segment):
    """Give s at x."""
    if segment.cutoff == 0:
        return x
    light = x * (segment.flat + 0.5 * segment.slope * x)
    if segment.led_rate > 0:
        light -= segment.transient * np.expm1(-segment.led_rate * x) / segment.led_rate
    return segment.cutoff * light


@njit(cache=True, error_model="numpy")
def _x_at(s, segment):
    """Give x at s: the root of a parabola, by Newton's method where LEDs rise."""
    if segment.cutoff == 0:
        return s
    light, begin = s / segment.cutoff, segment.flat + segment.transient
    if segment.led_rate == 0:
        return 2 * light / (begin + np.sqrt(max(begin * begin + 2 * segment.slope * light, 0.0)))
    x = segment.length * s / segment.span
    for _ in range(20):
        step = (s - _own_time(x, segment)) / (segment.cutoff * _light_at(x, segment))
        x = min(max(x + step, 0.0), segment.length)
        if abs(step) < 1e-9 * segment.length:
            break
    return x


@njit(cache=True)
def _light_at(x, segment):
    light = segment.flat + segment.slope * x
    return light + segment.transient * np.exp(-segment.led_rate * x) if segment.led_rate > 0 else light


@njit(cache=True, error_model="numpy")
def _growth_at(x, segment):
    """Give dlog I/ds at x."""
    light, rise = _light_at(x, segment), segment.slope
    if segment.led_rate > 0:
        rise -= segment.transient * segment.led_rate * np.exp(-segment.led_rate * x)
    return rise / light if segment.cutoff == 0 else rise / (segment.cutoff * light * light)


@njit(cache=True)
def _sums(t, poly):
    """Give the integral of the polynomial from the middle to t, and its value there."""
    integral, value = 0.0, 0.0
    for k in range(N_TERM, -1, -1):
        integral = integral * t + poly[k] * PER_ORDER[k]
        value = value * t + poly[k]
    return integral * t, value


@njit(cache=True, error_model="numpy")
def _look(s, segment, poly):
    """Give v and dv/ds at s."""
    if segment.cutoff == 0:
        return np.log(_light_at(s, segment)), _growth_at(s, segment)
    left = segment.excess * np.exp(-s)
    if segment.slope == 0 and segment.transient == 0:
        return segment.base - left, left
    integral, value = _sums(s - 0.5 * segment.span, poly)
    return segment.base + integral - left, value + left


@njit(cache=True, error_model="numpy")
def _growth_then(s, segment):
    """Give dlog I/ds at s."""
    if segment.cutoff == 0 or segment.led_rate > 0:
        return _growth_at(_x_at(s, segment), segment)
    begin = segment.flat + segment.transient
    return segment.slope / (segment.cutoff * begin * begin + 2 * segment.slope * s)


@njit(cache=True, error_model="numpy")
def _bounds(s, stop, rate, drift, segment):
    """Give how slow and how fast v + leak x is at the least and the most between s, where v has this rate, and stop."""
    growth, growth_stop = _growth_then(s, segment), _growth_then(stop, segment)
    slowest, fastest = min(rate, min(growth, growth_stop)), max(rate, max(growth, growth_stop))
    if segment.led_rate > 0:  # growth may turn
        more = 2 * abs(_growth_then(0.5 * (s + stop), segment) - 0.5 * (growth + growth_stop))
        slowest, fastest = slowest - more, fastest + more
    return slowest, fastest + drift


# ---- crossings ------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy")
def _next_crossing(s, stop, low, high, noise, tilt, leak, drift, segment, poly):
    """Find when v + noise + leak x first leaves low to high; the noise is linear. Gives s and +1 or -1, or stop and 0."""
    value, rate = _look(s, segment, poly)
    value += noise + leak * _x_at(s, segment)
    if value >= high or value <= low:
        return s, 1 if value >= high else -1
    if s >= stop:
        return stop, 0
    then = stop
    while True:
        value_then, rate_then = _look(then, segment, poly)
        value_then += noise + tilt * (then - s) + leak * _x_at(then, segment)
        slowest, fastest = 0.0, 0.0
        if segment.cutoff > 0 or leak > 0 or segment.led_rate > 0:
            slowest, fastest = _bounds(s, then, rate, drift, segment)
        slowest, fastest, ahead = slowest + tilt, fastest + tilt, then - s
        if slowest >= 0 or fastest <= 0 or max(fastest, -slowest) * ahead <= GRAZED:
            if value_then >= high or value_then <= low:
                sign, level = (1, high) if value_then >= high else (-1, low)
                return _find_crossing(
                    s, then, value - level, value_then - level, noise - level, tilt, leak, segment, poly
                ), sign
        elif value + fastest * ahead >= high or value + slowest * ahead <= low:
            then = s + 0.5 * ahead
            continue
        if then == stop:
            return stop, 0
        s, value, rate, noise, then = then, value_then, rate_then, noise + tilt * ahead, stop


@njit(cache=True, error_model="numpy")
def _find_crossing(s_low, s_high, f_low, f_high, offset, tilt, leak, segment, poly):
    """Find s where v + offset + tilt (s - s_low) + leak x = 0 by Newton's method; f_low and f_high differ in sign."""
    first = s_low
    if segment.cutoff == 0 and segment.led_rate == 0 and leak == 0:
        return min(max((np.exp(-offset) - segment.flat) / segment.slope, s_low), s_high)
    s = (s_low * f_high - s_high * f_low) / (f_high - f_low)
    for _ in range(100):
        value, rate = _look(s, segment, poly)
        f = value + offset + tilt * (s - first)
        if leak > 0:
            x = _x_at(s, segment)
            f += leak * x
            rate += leak if segment.cutoff == 0 else leak / (segment.cutoff * _light_at(x, segment))
        if abs(f) < CROSSING_TOLERANCE:
            break
        if (f > 0) == (f_high > 0):
            s_high = s
        else:
            s_low = s
        s -= f / (rate + tilt)
        if not s_low < s < s_high:
            s = 0.5 * (s_low + s_high)
    return s


# ---- noise ----------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy")
def _noise_until(s, state, node, noise, noise_then, sigma):
    """Draw the noise until s lies between its nodes: before the last one, and not before that before."""
    if sigma == 0 or node > s:
        return state, node, noise, noise_then
    skipped = int((s - node) / NOISE_STEP)
    if skipped > 0:
        kept = np.exp(-NOISE_STEP * skipped)
        state, normal = _draw_normal(state)
        noise_then = kept * noise_then + sigma * np.sqrt(1 - kept * kept) * normal
        node += NOISE_STEP * skipped
    state, normal = _draw_normal(state)
    return state, node + NOISE_STEP, noise_then, KEPT * noise_then + FRESH * sigma * normal


@njit(cache=True)
def _noise_at(s, node, noise, noise_then):
    return noise_then + (noise_then - noise) * (s - node) / NOISE_STEP


# ---- random numbers: splitmix64 (Steele et al. 2014), one stream per pixel, and a ziggurat ---------------


def _ziggurat(n: int = 256, start: float = 3.6541528853610088) -> tuple[np.ndarray, np.ndarray]:
    """Give the edges (n + 1,) of layers of equal area below exp(-x^2 / 2), and the density there (Marsaglia and Tsang
    2000); `start` is theirs, for 256 layers."""
    density = np.exp(-0.5 * start**2)
    area = start * density + np.sqrt(np.pi / 2) * math.erfc(start / np.sqrt(2))
    edge = np.empty(n + 1)
    edge[:2] = area / density, start
    for k in range(2, n):
        density += area / edge[k - 1]
        edge[k] = np.sqrt(-2 * np.log(density))
    edge[n] = 0
    return edge, np.exp(-0.5 * edge**2)


EDGE, DENSITY = _ziggurat()


@njit(cache=True)
def _draw_bits(state):
    """Give the next state and 64 random bits."""
    state += np.uint64(0x9E3779B97F4A7C15)
    z = state
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state, z ^ (z >> np.uint64(31))


@njit(cache=True)
def _draw_uniform(state):
    """Give the next state and a number in (0, 1)."""
    state, bits = _draw_bits(state)
    return state, (np.float64(bits >> np.uint64(11)) + 0.5) * 2.0**-53


@njit(cache=True)
def _draw_normal(state):
    """Give the next state and a normal deviate."""
    while True:
        state, bits = _draw_bits(state)
        k = np.int64(bits & np.uint64(255))
        x = ((np.float64(bits >> np.uint64(11)) + 0.5) * 2.0**-52 - 1) * EDGE[k]
        if abs(x) < EDGE[k + 1]:
            return state, x
        state, u = _draw_uniform(state)
        if k > 0:
            if DENSITY[k] + u * (DENSITY[k + 1] - DENSITY[k]) < np.exp(-0.5 * x * x):
                return state, x
            continue
        state, other = _draw_uniform(state)  # the tail
        beyond = -np.log(u) / EDGE[1]
        if -2 * np.log(other) > beyond * beyond:
            return state, EDGE[1] + beyond if x > 0 else -EDGE[1] - beyond


@njit(cache=True)
def _draw_thresholds(state, threshold_on, threshold_off, event_noise):
    """Give the next state and the thresholds in force until the next event."""
    if event_noise == 0:
        return state, np.float64(threshold_on), np.float64(threshold_off)
    state, first = _draw_normal(state)
    state, second = _draw_normal(state)
    on = max(threshold_on * (1 + event_noise * first), SMALLEST_THRESHOLD)
    off = max(threshold_off * (1 + event_noise * second), SMALLEST_THRESHOLD)
    return state, on, off
