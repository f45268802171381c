"""A stretch of time in which the light of a pixel, and v behind its photoreceptor, are closed forms; and where v crosses thresholds.

Time is the photoreceptor's own, s, see `pixel_kernel`.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

CHANGE = 0.2  # of log intensity in a segment: tanh(CHANGE)^N_TERM / 16, 1e-7, is left of the growth's integral (derived)
N_TERM = 8  # of the growth
SHORT = 0.5  # own time below which the lateness is its power series; rounding leaves 1e-12 on both sides (derived)
OF_RISE = 0.5  # of an LED's rise time in a segment, as long as it still rises
RISEN = 1e-12  # of the light, that may be missing of an LED's
MIN_STEP_US = 1e-3
GRAZED = 1e-9  # of log intensity, by which v may turn beyond a threshold unseen
CROSSING_TOLERANCE = 1e-12  # of log intensity
# Own time after which nothing is left of what was, and of a term of the series (1e-7)
LONG, ASYMPTOTIC = 40.0, 1 / 32
PER_ORDER = tuple(1 / k for k in range(1, N_TERM + 2))


class Segment(NamedTuple):
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


@njit(cache=True, error_model="numpy")
def late_after(span, late, slope, end, cutoff):
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
def length_of_segment(now, slope, transient, rest, model):
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
def new_segment(length, now, slope, transient, lagged, late, model, poly):
    """Give a segment that starts with this light, v and lateness, and write the polynomial of the lateness."""
    led_rate = model.led_rate if abs(transient) > RISEN * now else 0.0
    transient = transient if led_rate > 0 else 0.0
    flat = now - transient
    segment = Segment(length, length, flat, slope, transient, led_rate, model.cutoff, 0.0, 0.0)
    if model.cutoff == 0:
        return segment
    span = own_time(length, segment)
    middle = 0.5 * span
    if slope == 0 and transient == 0:
        poly[:] = 0
        return Segment(length, span, flat, slope, transient, led_rate, model.cutoff, lagged + late, late)
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
    return Segment(
        length, span, flat, slope, transient, led_rate, model.cutoff, lagged - integral + excess, excess
    )


@njit(cache=True, error_model="numpy")
def _fit_growth(segment, middle, poly):
    """Write the polynomial about the middle through the growth at N_TERM times (Newton's)."""
    at, last = np.empty(N_TERM), N_TERM - 1
    newton = np.empty(N_TERM)
    for j in range(N_TERM):
        x = segment.length * 0.5 * (1 - np.cos(np.pi * (j + 0.5) / N_TERM))
        at[j], newton[j] = own_time(x, segment) - middle, _growth_at(x, segment)
    for order in range(1, N_TERM):
        for j in range(last, order - 1, -1):
            newton[j] = (newton[j] - newton[j - 1]) / (at[j] - at[j - order])
    poly[:] = 0
    for j in range(last, -1, -1):
        for k in range(last, 0, -1):
            poly[k] = poly[k - 1] - at[j] * poly[k]
        poly[0] = newton[j] - at[j] * poly[0]


@njit(cache=True, error_model="numpy")
def own_time(x, segment):
    """Give s at x."""
    if segment.cutoff == 0:
        return x
    light = x * (segment.flat + 0.5 * segment.slope * x)
    if segment.led_rate > 0:
        light -= segment.transient * np.expm1(-segment.led_rate * x) / segment.led_rate
    return segment.cutoff * light


@njit(cache=True, error_model="numpy")
def x_at(s, segment):
    """Give x at s: the root of a parabola, by Newton's method where LEDs rise."""
    if segment.cutoff == 0:
        return s
    light, begin = s / segment.cutoff, segment.flat + segment.transient
    if segment.led_rate == 0:
        return 2 * light / (begin + np.sqrt(max(begin * begin + 2 * segment.slope * light, 0.0)))
    x = segment.length * s / segment.span
    for _ in range(20):
        step = (s - own_time(x, segment)) / (segment.cutoff * _light_at(x, segment))
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
def look(s, segment, poly):
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
        return _growth_at(x_at(s, segment), segment)
    begin = segment.flat + segment.transient
    return segment.slope / (segment.cutoff * begin * begin + 2 * segment.slope * s)


@njit(cache=True, error_model="numpy")
def bounds(s, stop, rate, drift, segment):
    """Give how slow and how fast v + leak x is at the least and the most between s, where v has this rate, and stop."""
    growth, growth_stop = _growth_then(s, segment), _growth_then(stop, segment)
    slowest, fastest = min(rate, min(growth, growth_stop)), max(rate, max(growth, growth_stop))
    if segment.led_rate > 0:  # growth may turn
        more = 2 * abs(_growth_then(0.5 * (s + stop), segment) - 0.5 * (growth + growth_stop))
        slowest, fastest = slowest - more, fastest + more
    return slowest, fastest + drift


@njit(cache=True, error_model="numpy")
def next_crossing(s, stop, low, high, noise, tilt, leak, drift, segment, poly):
    """Find when v + noise + leak x first leaves low to high; the noise is linear. Gives s and +1 or -1, or stop and 0."""
    value, rate = look(s, segment, poly)
    value += noise + leak * x_at(s, segment)
    if value >= high or value <= low:
        return s, 1 if value >= high else -1
    if s >= stop:
        return stop, 0
    then = stop
    while True:
        value_then, rate_then = look(then, segment, poly)
        value_then += noise + tilt * (then - s) + leak * x_at(then, segment)
        slowest, fastest = 0.0, 0.0
        if segment.cutoff > 0 or leak > 0 or segment.led_rate > 0:
            slowest, fastest = bounds(s, then, rate, drift, segment)
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
        value, rate = look(s, segment, poly)
        f = value + offset + tilt * (s - first)
        if leak > 0:
            x = x_at(s, segment)
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
