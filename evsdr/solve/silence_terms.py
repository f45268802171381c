"""What silence says: between two events of a pixel neither threshold has been reached before.

After each event an ON and an OFF threshold are drawn anew, and the change q of log I since the reference was memorised
reaches one of them first. So up to an event, or the end of the recording,

- the threshold that was not reached lies beyond the largest excursion x to its side: that has the probability
  S((C - x) / (noise C)), S of `law.survival`;
- the threshold that was reached at q was not reached before, so q lies beyond the earlier excursion x to its own side.
  As times jitter, that has the probability S((q - x) / (JITTER noise C)).

While LEDs fade linearly the light is extreme at the starts of slots, so those are the probes. Which of them is the
extreme depends on the maps, and is looked for anew at each evaluation: neighbouring probes tell the same thing, and
only once.
"""

import drjit as dr

from evsdr.solve import law
from evsdr.solve.light import Light
from evsdr.solve.pair_data import PairData, array_type, looked_up

# Of log I at an event, relative to the noise of its threshold; guessed: 0.1 to 1 make no difference
JITTER = 1.0


def silence_equations(table, pairs: PairData, constant_light, n_band: int, scale, thresholds: bool = False):
    """Sum cost, gradient and matrix of each pixel over its silences.

    Arguments and results as those of `event_terms.normal_equations`.
    """
    Float, UInt32 = type(pairs.phases), type(pairs.first)
    n = 2 + n_band + 2 * thresholds
    pixel = dr.arange(UInt32, dr.width(pairs.threshold_on))
    first, last = pairs.silent_first, pairs.silent_last
    light = Light(table, pairs, constant_light, n_band)

    def body(k, again, cost, *sums):
        start, coded = dr.gather(array_type(Float, 2), pairs.silent_phases, k, k < last)
        highest, lowest = _extremes(light, pixel, k, start, k < last)
        on = (highest != start) & ~again
        both = on & (lowest != start)  # then the silence comes again, for the other side
        side, extreme = dr.select(on, Float(1.0), -1.0), dr.select(on, highest, lowest)
        active = (k < last) & (extreme != start)
        fired = coded * side > 0
        base = dr.select(fired, dr.abs(coded) - 1.0, start)
        (most, by_most), (total, by_base) = (
            light.of(light.entries(pixel, phase, active)) for phase in (extreme, base)
        )
        threshold = dr.select(on, pairs.threshold_on, pairs.threshold_off)
        gain = side / (threshold * scale * dr.select(fired, Float(JITTER), 1.0))
        bias = dr.select(fired, 0.0, looked_up(pairs.silent_bias, k, active))
        short = gain * (dr.log(total / most) - bias)
        jacobian = [gain * (b - a) for a, b in zip(by_most, by_base)]
        jacobian += [dr.select(which, -short, 0.0) for which in (on, ~on)] if thresholds else []
        value, slope, bend = law.survival(short + dr.select(fired, Float(0.0), dr.rcp(scale)))
        slope, bend = dr.select(active, slope, 0.0), dr.select(active, bend, 0.0)
        gradient = [-slope * j for j in jacobian]
        matrix = [bend * jacobian[i] * jacobian[j] for i in range(n) for j in range(i + 1)]
        more = [dr.select(active, value, 0.0), *gradient, *matrix]
        return (k + dr.select(both, UInt32(0), 1), both, *(s + t for s, t in zip((cost, *sums), more)))

    zero = [dr.zeros(Float, dr.width(pixel)) for _ in range(1 + n + n * (n + 1) // 2)]
    begin = first, first > last, *zero
    _, _, cost, *sums = dr.while_loop(begin, lambda k, *_: k < last, body, label="silence terms")
    return cost, sums[:n], sums[n:]


def _extremes(light: Light, pixel, k, start, active):
    """Give the phases of the probes where the light is highest and lowest; `start` if none is beyond that."""
    pairs = light.pairs
    probe, end = dr.gather(array_type(type(pairs.first), 2), pairs.silent_probes, k, active)

    def body(probe, most, highest, least, lowest):
        here = dr.gather(type(start), pairs.probes, probe, active)
        value = light.at(pixel, here, active)
        up, down = value > most, value < least
        highest, lowest = dr.select(up, here, highest), dr.select(down, here, lowest)
        return probe + 1, dr.maximum(value, most), highest, dr.minimum(value, least), lowest

    now = light.at(pixel, start, active)
    begin = probe, now, start, now, start
    found = dr.while_loop(begin, lambda probe, *_: active & (probe < end), body, label="extreme probes")
    return found[2], found[4]
