"""The event log-ratio loss and its normal equations, summed over the pairs of each pixel.

A pair of events says  log I(t_k) - log I(t_(k-1) + refractory) = p_k C  (EventSpecPS eq. 5, with the
reference memorised at the end of the refractory period). Its residual is relative to the threshold,

    u = p_k f / C - 1,    f = log I(end) - log I(start),

because an absolute one vanishes together with the contrast. Nothing here knows Mitsuba.
"""

import sys
from dataclasses import dataclass

import drjit as dr


@dataclass(frozen=True)
class PairData:
    """Event pairs of the pixels to solve, as Dr.Jit arrays.

    Attributes
    ----------
    offset : UInt32, (n_pixel + 1)
        Pairs of pixel i are offset[i] .. offset[i+1].
    phase_start, phase_end : Float, (n_pair)
        Phase of the ring (slot + crossfade fraction) at which a pair starts and ends.
    polarity : Float, (n_pair)
        +1 or -1.
    threshold_on, threshold_off : Float, (n_pixel)
        Contrast thresholds.
    slot_led, slot_band : UInt32, (n_slot + 1)
        LED of each slot, the first again after the last, and its band; LED n_led is darkness.
    """

    offset: object
    phase_start: object
    phase_end: object
    polarity: object
    threshold_on: object
    threshold_off: object
    slot_led: object
    slot_band: object


@dataclass(frozen=True)
class Tables:
    """Signals of all LEDs and darkness, LED after LED: entry j * n_pixel + pixel.

    Attributes
    ----------
    signal, by_p, by_q : Float, ((n_led + 1) * n_pixel)
        A_xj and its derivatives by the slopes.
    constant_light : Float
        C_w; a floor keeps the logarithm finite where it is 0.
    """

    signal: object
    by_p: object
    by_q: object
    constant_light: object


def flatten_leds(per_led: list, n_pixel: int):
    """Lay per-LED arrays out LED after LED, with a row of zeros for darkness."""
    Float = type(per_led[0])
    ArrayXf = sys.modules[Float.__module__].ArrayXf
    rows = ArrayXf([dr.zeros(Float, n_pixel) + row for row in per_led] + [dr.zeros(Float, n_pixel)])
    return dr.ravel(rows, order="C")


def _end(tables: Tables, pairs: PairData, phase, pixel, n_pixel, active, slopes: bool):
    """Look up the light at one end of a pair: its two LEDs, their weights, bands and signals."""
    Float, UInt32 = type(phase), type(pixel)
    slot = UInt32(phase)
    fade = phase - Float(slot)
    leds = []
    for step, weight in ((0, 1.0 - fade), (1, fade)):
        led = dr.gather(UInt32, pairs.slot_led, slot + step, active)
        band = dr.gather(UInt32, pairs.slot_band, slot + step, active)
        at = led * n_pixel + pixel
        tables_used = (tables.signal, tables.by_p, tables.by_q) if slopes else (tables.signal,)
        leds.append((band, [weight * dr.gather(Float, table, at, active) for table in tables_used]))
    intensity = leds[0][1][0] + leds[1][1][0] + tables.constant_light
    return intensity, leds


def ends(tables: Tables, pairs: PairData, k, pixel, n_pixel, active):
    """Look up the tables' signal plus constant light at start and end of pair k."""
    Float = type(pairs.phase_start)
    phases = (dr.gather(Float, p, k, active) for p in (pairs.phase_start, pairs.phase_end))
    start, end = (_end(tables, pairs, phase, pixel, n_pixel, active, False)[0] for phase in phases)
    return start, end


def threshold_met(pairs: PairData, k, pixel, active):
    """Look up the polarity of pair k and the threshold that it met."""
    Float = type(pairs.polarity)
    polarity = dr.gather(Float, pairs.polarity, k, active)
    on, off = (dr.gather(Float, value, pixel, active) for value in (pairs.threshold_on, pairs.threshold_off))
    return polarity, dr.select(polarity > 0, on, off)


def relative_residual(tables: Tables, pairs: PairData, k, pixel, n_pixel, active):
    """Give u of pair k, of that pixel; 0 where inactive. Differentiable in the tables' signal."""
    start, end = ends(tables, pairs, k, pixel, n_pixel, active)
    polarity, threshold = threshold_met(pairs, k, pixel, active)
    return dr.select(active, polarity * dr.log(end / start) / threshold - 1.0, 0.0)


def normal_equations(tables: Tables, pairs: PairData, n_pixel, n_band: int, scale, robust):
    """Sum cost, gradient and Gauss-Newton matrix of each pixel over its pairs.

    The cost of a pair is Cauchy's, robust^2 / 2 log(1 + (r / robust)^2) for r = u / scale.

    Parameters
    ----------
    n_pixel : UInt32
        Number of pixels, opaque.
    scale : Float
        Standard deviation of u.
    robust : Float
        Width of the Cauchy cost in standard deviations.

    Returns
    -------
    cost : Float, (n_pixel)
    gradient : list of Float, (2 + n_band)
        By p, q and the log reflectances.
    matrix : list of Float, ((2 + n_band)(3 + n_band) / 2)
        Lower triangle, row after row.
    """
    Float, UInt32 = type(pairs.phase_start), type(pairs.offset)
    n = 2 + n_band
    pixel = dr.arange(UInt32, dr.width(pairs.threshold_on))
    first = dr.gather(UInt32, pairs.offset, pixel)
    last = dr.gather(UInt32, pairs.offset, pixel + 1)

    def body(k, cost, *sums):
        active = k < last
        jacobian = [Float(0.0) for _ in range(n)]
        intensity = []
        for sign, phases in ((-1.0, pairs.phase_start), (1.0, pairs.phase_end)):
            phase = dr.gather(Float, phases, k, active)
            total, leds = _end(tables, pairs, phase, pixel, n_pixel, active, True)
            per = sign * dr.rcp(total)
            intensity.append(total)
            for band, (signal, by_p, by_q) in leds:
                jacobian[0] += per * by_p
                jacobian[1] += per * by_q
                for b in range(n_band):
                    jacobian[2 + b] += dr.select(band == b, per * signal, 0.0)
        polarity, threshold = threshold_met(pairs, k, pixel, active)
        to_relative = polarity / (threshold * scale)
        r = to_relative * dr.log(intensity[1] / intensity[0]) - dr.rcp(scale)
        excess = dr.square(r / robust)
        weight = dr.rcp(1.0 + excess)
        cost += 0.5 * dr.square(robust) * dr.log(1.0 + excess)
        jacobian = [to_relative * j for j in jacobian]
        weighted = [weight * j for j in jacobian]
        terms = [w * r for w in weighted]
        terms += [weighted[i] * jacobian[j] for i in range(n) for j in range(i + 1)]
        return (k + 1, cost, *(s + t for s, t in zip(sums, terms)))

    zero = [dr.zeros(Float, dr.width(pixel)) for _ in range(1 + n + n * (n + 1) // 2)]
    state = dr.while_loop((first, *zero), lambda k, *_: k < last, body, label="event pairs")
    return state[1], list(state[2 : 2 + n]), list(state[2 + n :])
