"""A stretch of time in which the light of a pixel, and v behind its photoreceptor, are closed forms; and where v crosses thresholds.

Time is the photoreceptor's own, s, see `pixel_kernel`.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

CHANGE = 0.35  # of log intensity in a segment; v is then right to 1.3e-7 (measured by tiny steps)
N_TERM = 8  # of the growth
SHORT = 0.5  # own time below which the lateness is its power series; rounding leaves 3e-12 on the other side (derived)
OF_RISE = 0.75  # of an LED's rise time in a segment while its rise is as large as the light; v is as right (measured likewise)
RISEN = 1e-12  # of the light, that may be missing of an LED's
MIN_STEP_US = 1e-3
TINY = 1e-300
GRAZED = 1e-9  # of log intensity, by which v may turn beyond a threshold unseen
CROSSING_TOLERANCE = 1e-13  # of log intensity
# Own time after which nothing is left of what was, and of a term of the series (1e-7)
LONG, ASYMPTOTIC = 40.0, 1 / 32
RISEN_BY, FALLEN_BY = float(np.expm1(CHANGE)), float(np.expm1(-CHANGE))  # of the light at a segment's begin
PER_UNIT = 16  # of own time: entries of a table of exp(-s)
LEFT = np.exp(-np.arange(LONG * PER_UNIT + 1) / PER_UNIT)
PER_ORDER = tuple(1 / k for k in range(1, N_TERM + 2))
FAST = {"contract"}  # a * b + c in one go


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
    then: float  # v and lateness at the end
    late_then: float


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def left_after(s):
    """Give exp(-s) for s of 0 or more, to 1e-14 (derived): from a table, by its series about the nearest entry."""
    s = min(s, LONG)
    k = int(PER_UNIT * s + 0.5)
    r = k / PER_UNIT - s
    return LEFT[k] * (1 + r * (1 + r * (1 / 2 + r * (1 / 6 + r * (1 / 24 + r * (1 / 120 + r * (1 / 720)))))))


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def late_after(span, late, slope, end, cutoff):
    """Give the lateness when an even fade to `end` is over, nan where its asymptotic series will not do."""
    if cutoff == 0:
        return 0.0
    if slope == 0:
        return late * left_after(span)
    growth = slope / (cutoff * end * end)
    if span < LONG or abs(growth) > 0.5 * ASYMPTOTIC:
        return np.nan
    late, term = 0.0, growth
    for k in range(1, N_TERM):
        late += term
        term *= 2 * growth * k
    return late


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def length_of_segment(now, slope, transient, rest, model):
    """Give how long growth is a polynomial [us], the longer the less an LED still rises; light alone is exact as long as it
    goes one way."""
    rises = abs(transient) > RISEN * now
    if not rises and (slope == 0 or model.cutoff == 0):
        return rest
    if not rises:
        length = now * (RISEN_BY if slope > 0 else FALLEN_BY) / slope
    else:
        steepness = abs(slope) + abs(transient) * model.led_rate
        few = OF_RISE * (now / abs(transient)) ** (1 / N_TERM)
        length = min(-FALLEN_BY * now / steepness, few * model.led_rise_us)
    return min(max(length, MIN_STEP_US), rest)


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def new_segment(length, now, slope, transient, lagged, late, model, poly):
    """Give a segment that starts with this light, v and lateness, and write the polynomial of the lateness."""
    led_rate = model.led_rate if abs(transient) > RISEN * now else 0.0
    transient = transient if led_rate > 0 else 0.0
    flat = now - transient
    segment = Segment(length, length, flat, slope, transient, led_rate, model.cutoff, 0.0, 0.0, 0.0, 0.0)
    if model.cutoff == 0:
        return segment
    span = own_time(length, segment)
    middle = 0.5 * span
    if slope == 0 and transient == 0:
        left = late * left_after(span)
        then = lagged + late - left
        return Segment(
            length, span, flat, slope, transient, led_rate, model.cutoff, lagged + late, late, then, left
        )
    if transient == 0:
        bend = slope / (model.cutoff * now * now + slope * span)  # 1 / (2 c) in the middle
        _fit_even_growth(bend, span, poly)
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
    base, left = lagged - integral + excess, excess * left_after(span)
    integral, value = _sums(middle, poly)
    then = base + integral - left
    return Segment(
        length, span, flat, slope, transient, led_rate, model.cutoff, base, excess, then, value + left
    )


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _fit_even_growth(bend, span, poly):
    """Write a polynomial near bend / (1 + 2 bend t) for 2 |t| up to the span.

    That is (1 - T(2 t / span) / T(-1 / (bend span))) bend / (1 + 2 bend t) with Chebyshev's polynomial T of order 8, which the
    denominator divides: the error is as small everywhere, a hundredth of the power series' at the ends.
    """
    far, steep = (bend * span) ** 2, 4 * bend * bend
    last = bend / (128 - far * (256 - far * (160 - far * (32 - far))))
    poly[0], poly[2] = bend - last * far**4, 32 * last * far**3 * steep
    poly[4], poly[6] = -160 * last * far**2 * steep**2, 256 * last * far * steep**3
    poly[1] = poly[3] = poly[5] = poly[7] = 0.0
    for k in range(1, N_TERM):
        poly[k] -= 2 * bend * poly[k - 1]


@njit(cache=True, error_model="numpy", fastmath=FAST)
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


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def own_time(x, segment):
    """Give s at x."""
    if segment.cutoff == 0:
        return x
    light = x * (segment.flat + 0.5 * segment.slope * x)
    if segment.led_rate > 0:
        light -= segment.transient * np.expm1(-segment.led_rate * x) / segment.led_rate
    return segment.cutoff * light


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
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


@njit(cache=True, fastmath=FAST, forceinline=True)
def _light_at(x, segment):
    light = segment.flat + segment.slope * x
    return light + segment.transient * np.exp(-segment.led_rate * x) if segment.led_rate > 0 else light


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _growth_at(x, segment):
    """Give dlog I/ds at x."""
    light, rise = _light_at(x, segment), segment.slope
    if segment.led_rate > 0:
        rise -= segment.transient * segment.led_rate * np.exp(-segment.led_rate * x)
    return rise / light if segment.cutoff == 0 else rise / (segment.cutoff * light * light)


@njit(cache=True, fastmath=FAST, forceinline=True)
def _sums(t, poly):
    """Give the integral of the polynomial from the middle to t, and its value there."""
    integral, value = 0.0, 0.0
    for k in range(N_TERM, -1, -1):
        integral = integral * t + poly[k] * PER_ORDER[k]
        value = value * t + poly[k]
    return integral * t, value


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def look(s, segment, poly):
    """Give v and dv/ds at s."""
    if segment.cutoff == 0:
        return np.log(_light_at(s, segment)), _growth_at(s, segment)
    left = segment.excess * left_after(s)
    if segment.slope == 0 and segment.transient == 0:
        return segment.base - left, left
    integral, value = _sums(s - 0.5 * segment.span, poly)
    return segment.base + integral - left, value + left


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _growth_then(s, segment):
    """Give dlog I/ds at s."""
    if segment.cutoff == 0 or segment.led_rate > 0:
        return _growth_at(x_at(s, segment), segment)
    begin = segment.flat + segment.transient
    return segment.slope / (segment.cutoff * begin * begin + 2 * segment.slope * s)


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def bounds(s, stop, rate, drift, segment):
    """Give how slow and how fast v + leak x is at the least and the most between s, where v has this rate, and stop."""
    growth, growth_stop = _growth_then(s, segment), _growth_then(stop, segment)
    least, most = min(growth, growth_stop), max(growth, growth_stop)
    if segment.led_rate > 0:  # growth may turn
        more = 2 * abs(_growth_then(0.5 * (s + stop), segment) - 0.5 * (growth + growth_stop))
        least, most = least - more, most + more
    if segment.cutoff == 0:
        return least, most + drift
    soon = min(stop - s, 1.0)  # 1 - exp(s - stop) at most: as far the lateness goes to the growth
    return rate - soon * max(rate - least, 0.0), rate + soon * max(most - rate, 0.0) + drift


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def free_time(gap, gap_then, slowest, fastest, ahead):
    """Give how long something surely does not rise by `gap`, which is `gap_then` after `ahead`; that is long if it never does."""
    if gap <= 0:
        return 0.0
    free = gap / max(fastest, TINY)
    if slowest >= 0:
        return max(free, ahead + gap_then / max(slowest, TINY))
    return np.inf if free - gap_then / slowest > ahead else free


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def next_crossing(s, x, stop, value, rate, low, high, noise, tilt, leak, drift, segment, poly):
    """Find when v + noise + leak x first leaves low to high; the noise is linear.

    Gives s, x, and +1 or -1, or 0 at `stop`. At first `value` is v + leak x, and `rate` is dv/ds.
    """
    value += noise
    if value >= high or value <= low:
        return s, x, 1 if value >= high else -1
    then = stop
    while s < stop:
        value_then, rate_then = look(then, segment, poly)
        x_then = x_at(then, segment)
        value_then += noise + tilt * (then - s) + leak * x_then
        slowest, fastest = bounds(s, then, rate, drift, segment)
        slowest, fastest, ahead = slowest + tilt, fastest + tilt, then - s
        if slowest >= 0 or fastest <= 0 or max(fastest, -slowest) * ahead <= GRAZED:
            if value_then >= high or value_then <= low:
                sign, level = (1, high) if value_then >= high else (-1, low)
                ends = x, x_then, value - level, value_then - level
                bend = (fastest - slowest) / (min(ahead, 1.0) if segment.cutoff > 0 else ahead)
                x = _find_crossing(*ends, noise - level - tilt * s, tilt, bend, leak, segment, poly)
                return own_time(x, segment), x, sign
        elif value + fastest * ahead >= high or value + slowest * ahead <= low:
            then = s + 0.5 * ahead
            continue
        s, x, value, rate, noise, then = then, x_then, value_then, rate_then, noise + tilt * ahead, stop
    return s, x, 0


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _find_crossing(x_low, x_high, f_low, f_high, offset, tilt, bend, leak, segment, poly):
    """Find x where v + offset + tilt s + leak x = 0 by Newton's method; f_low and f_high differ in sign.

    The second derivative of v with respect to s is `bend` at most.
    """
    steepness = segment.cutoff * (abs(segment.slope) + abs(segment.transient) * segment.led_rate)
    x = (x_low * f_high - x_high * f_low) / (f_high - f_low)
    for _ in range(100):
        s = own_time(x, segment)
        value, rate = look(s, segment, poly)
        f = value + offset + tilt * s + leak * x
        if abs(f) < CROSSING_TOLERANCE:
            break
        if (f > 0) == (f_high > 0):
            x_high = x
        else:
            x_low = x
        rate += tilt
        pace = segment.cutoff * _light_at(x, segment) if segment.cutoff > 0 else 1.0  # ds/dx
        step = f / (rate * pace + leak)
        x -= step
        if not x_low < x < x_high:
            x = 0.5 * (x_low + x_high)
        elif (bend * pace * pace + steepness * abs(rate)) * step * step < CROSSING_TOLERANCE:
            break
    return x
