"""Cost, gradient and information of pixels by their maps and by what all pixels share, in float64.

Between two events of a pixel

    v(t_k) + p_k sigma lead_k - v(r_k) - p_(k-1) sigma kept lead_(k-1) + leak (t_k - r_k) = p_k C (1 + noise),

with v the log light behind the photoreceptor (`receptor`), r_k = t_(k-1) + refractory, sigma lead what the receptor's
noise adds when it fires an event (`lead`), and kept what is left of that at r_k. Times have the density of the first
passage: that of the threshold that was met, times |dv/dt + leak| / C, times the probability that the other threshold was not
met before. Derivatives stand at the light that v shows, times how v answers to more light (`_answer`).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from evsdr.events.lead import kept, lead_of, poles_of
from evsdr.events.receptor import N_COLUMN, follow, late_at, light_at, phase_at, shown_at
from evsdr.solve.law import GAUSS, SHARE, SLOWEST, STUDENT
from evsdr.solve.shared.rig import N_TIMING
from evsdr.threads import N_CHUNK, in_chunks

FAR = 5.0  # standard deviations of a threshold within which silence says nothing
# Columns after those of the LEDs
TAU, DARK, NOISE, SHIFT, REFRACTORY, LEAK, POLE, ON, OFF, DISTANCE = range(10)
BY_DISTANCE = 4  # row of the signals
STIRRED = TAU, DARK, NOISE, POLE  # by which derivatives are differences
EARLIER = 1e-6  # slots, for derivatives
KINK = 0.01  # change of the rarity by a small step of timing that no smooth light makes
TURN = 0.2  # of a lead, by a small step of tau: where light turns, one event would tell tau better than all others
LONG, TINY = -2.0, 1e-300  # below which the curvature is that of the tangent parabola about 0


class Terms(NamedTuple):
    """How pairs count."""

    crossfade: float
    scatter: float  # of the relative residual, beside the photoreceptor's noise
    robust: float  # width of Cauchy's cost in standard deviations
    slope_term: float  # weight of the density of event times
    clock: float = 0.0  # slots in which a time may lie evenly


@njit(cache=True, error_model="numpy")
def _survival(y):
    """Give -log of the probability that a threshold lies above -y, its derivative, and a curvature, see `law.survival`."""
    fall = 1 / (1 + y * y / 3)
    gauss, student = (1 - SHARE) * GAUSS * np.exp(-0.5 * y * y), SHARE * STUDENT * fall * fall
    density = gauss + student
    weight = (gauss + 4 / 3 * fall * student) / density
    t = y / np.sqrt(3.0)
    below = 0.5 + (t / (1 + t * t) + math.atan(t)) / np.pi
    above = (1 - SHARE) * 0.5 * math.erfc(-y / np.sqrt(2.0)) + SHARE * max(below, TINY)
    slope = density / above
    return -np.log(above), -slope, -slope / y if y < LONG else slope * (slope + weight * y)


@njit(cache=True, error_model="numpy")
def _add_light(row, factor, slot, fade, leds, table, tilt, veil, band, n_map):
    """Add factor times the derivatives of log I at a phase to a row."""
    n_led, n_slot = len(band), len(leds)
    now, following = leds[slot], leds[(slot + 1) % n_slot]
    total = veil + ((1 - fade) * table[0, now] if now < n_led else 0.0)
    total += fade * table[0, following] if following < n_led else 0.0
    for led, share in ((now, 1 - fade), (following, fade)):
        if led < n_led and share > 0:
            part = factor * share / total
            row[0] += part * table[1, led]
            row[1] += part * table[2, led]
            row[2 + band[led]] += part * table[3, led]
            row[n_map + led] += part * table[0, led]
            if len(table) > BY_DISTANCE:
                row[n_map + n_led + DISTANCE] += part * table[BY_DISTANCE, led]
            for k in range(tilt.shape[1]):
                row[n_map + n_led + N_TIMING + 2 * led + k] += part * table[0, led] * tilt[led, k]


@njit(cache=True, error_model="numpy")
def _add(matrix, gradient, row, slope, bend):
    """Add a term with its first two derivatives by what the row is the derivative of."""
    for i in range(len(row)):
        if row[i] != 0:
            gradient[i] += slope * row[i]
            part = bend * row[i]
            for j in range(i + 1):
                matrix[i, j] += part * row[j]


@njit(cache=True, error_model="numpy")
def _change_of_light(at, light, crossfade):
    """Give dI/dt, per slot."""
    slot = min(int(at), len(light) - 1)
    if crossfade == 0 or at - slot < 1 - crossfade:
        return 0.0
    return (light[(slot + 1) % len(light)] - light[slot]) / crossfade


@njit(cache=True, error_model="numpy")
def _change_of_kept(own_time, pole):
    """Give the derivatives of `lead.kept`."""
    poles = poles_of(pole)
    slow, fast = math.exp(-own_time), math.exp(-poles * own_time)
    return poles * (fast - slow) / (poles - 1), (poles * fast - slow) / (poles - 1)


@njit(cache=True, error_model="numpy")
def _answer(late, values, moved_by):
    """Give dv / dlog of all light, of log I - v for each of `sets`.

    v of light c I is v + log c of a receptor whose tau and dark current are c times smaller. A tau that is not asked for is tiny:
    then log I - v is in proportion to it.
    """
    answer = 1 + (values[TAU] * (late[TAU + 1] - late[0]) / moved_by[TAU] if moved_by[TAU] != 0 else late[0])
    if moved_by[DARK] != 0:
        answer += values[DARK] * (late[DARK + 1] - late[0]) / moved_by[DARK]
    return answer


@njit(cache=True, error_model="numpy")
def _rarity(p, late, own, slowest):
    """Give -log p dv/dt, of dv/dt = (log I - v) (I + dark) / tau."""
    return -np.log(0.5 * (p * late + np.sqrt(late * late + (slowest / own) ** 2)) * own)


@njit(cache=True, error_model="numpy")
def _look(at, light, nodes, values, crossfade):
    """Give how late a photoreceptor is, log I, and the rate of its own time."""
    late = late_at(at, light, values[TAU], values[DARK], crossfade, nodes)
    now = light_at(at, light, crossfade)
    return late, np.log(now), (now + values[DARK]) / values[TAU]


def pixel_sums(
    events,
    leds,
    band,
    veil,
    signals,
    tilts,
    thresholds,
    own_thresholds,
    values,
    terms,
    lead,
    weigh,
    some=None,
    kind=None,
):
    """Sum over the events of each pixel.

    Parameters
    ----------
    events : tuple
        offset (n_pixel + 1,) int64; at (n_event,) float64, slot + the fraction of it that is over; gap (n_event,)
        float64, slots since the event before; polarity (n_event,) int8; inside (n_event,) bool, whether the rounds
        have run since the event before; ending (n_pixel,) float64, slots from the last event to the recording's end.
    leds : (n_slot,) int64
        LED of each slot; n_led is darkness.
    band : (n_led,) int64
    veil : float
        C_w.
    signals : (n_pixel, 4 or 5, n_led) float64
        A_xj, its derivatives by p and q, the part that scales with the reflectance, and, where LEDs are near to a surface
        whose distance is unknown, the derivative by that.
    tilts : (n_pixel, n_led, 2 or 0) float64
        Derivatives of log A_xj by the LED's direction.
    thresholds : (n_pixel, 2) float64
        C_on, C_off.
    own_thresholds : bool
        Whether the logarithms of these are the last unknowns of each pixel; else those of two factors are shared.
    values : (5, 7) float64
        tau (above 0), dark current, noise, shift, refractory period, leak and pole, times in slots; then one of `STIRRED`
        after the other moved a little, for derivatives, or not, for none.
    terms : Terms
    lead : (2, n) float64
        `lead.TABLE`.
    weigh : (n_event,) float64
        Variance of u by the photoreceptor's noise and the clock's steps, by which events are weighed.
    some : (n,) int64, optional
        Only these pixels; by default all.
    kind : (n_event,) int64, optional
        Of each event, from 0: gradients are then summed kind by kind.

    Returns
    -------
    cost : (n_pixel,)
    gradient : (n_pixel, n + m), or (n_pixel, n_kind, n + m)
    matrix : (n_pixel, n + m, n + m)
        Information that the pixel gives of its n unknowns and the m shared ones.
    residual : (n_event,)
        u of the event; NaN where it counts for nothing.
    variance : (n_event,)
        That of u by the photoreceptor's noise and the clock's steps.
    """
    n_pixel, n_event = len(signals), len(events[1])
    n = 3 + band.max() + 2 * own_thresholds
    m = len(band) * (1 + tilts.shape[2]) + N_TIMING
    of_event = np.zeros(n_event, np.int64) if kind is None else kind
    out = (
        np.zeros(n_pixel),
        np.zeros((n_pixel, 1 + of_event.max(initial=0), n + m)),
        np.zeros((n_pixel, n + m, n + m)),
        np.full(n_event, np.nan),
        np.zeros(n_event),
    )
    moved_by = np.array([values[row, column] - values[0, column] for row, column in enumerate(STIRRED, 1)])
    sets = np.append(np.flatnonzero(moved_by[:NOISE]) + 1, 0)  # another tau, another dark current, as told
    others = np.flatnonzero(moved_by[NOISE:]) + NOISE + 1  # another noise, another pole
    stirred = moved_by, sets, others
    given = leds, band, veil, signals, tilts, thresholds, own_thresholds, values, stirred, terms, lead, weigh

    some = np.arange(n_pixel) if some is None else some

    def run(chunk):
        _run(chunk, some, of_event, events, *given, *out)

    in_chunks(run)
    cost, gradient, *rest = out
    return cost, gradient[:, 0] if kind is None else gradient, *rest


@njit(cache=True, nogil=True, error_model="numpy")
def _run(
    chunk, some, kind, events, leds, band, veil, signals, tilts, thresholds, own_thresholds, values, stirred, terms, lead,
    weigh, cost, gradient, information, residual, variance,
):  # fmt: skip
    """Sum over the pixels of a chunk; see `pixel_sums`."""
    offset, at, gap, polarity, inside, ending = events
    n_led, n_slot = len(band), len(leds)
    moved_by, sets, others = stirred
    n_all = gradient.shape[2]
    n = n_all - n_led * (1 + tilts.shape[2]) - N_TIMING
    timing = n + n_led
    logs = n - 2 if own_thresholds else timing + ON  # first column of the thresholds
    crossfade, told_noise = terms.crossfade, values[0, NOISE]
    tau, shift, refractory, leak = values[0, TAU], values[0, SHIFT], values[0, REFRACTORY], values[0, LEAK]
    pole = values[0, POLE]
    row, light = np.zeros(n_all), np.zeros(n_slot)
    nodes, shown = np.zeros((3, n_slot, N_COLUMN)), np.zeros((3, n_slot))
    met, reference, rarity, noise = np.zeros(5), np.zeros(5), np.zeros(5), np.zeros((5, 2))
    lates = np.zeros((2, 3))  # log I - v by `sets`, where the reference is memorised and where v is looked at
    for i in some[chunk::N_CHUNK]:
        table, tilt, matrix = signals[i], tilts[i], information[i]
        for k in range(n_slot):
            light[k] = veil + (table[0, leds[k]] if leds[k] < n_led else 0.0)
        for q in sets:
            follow(light, values[q, TAU], values[q, DARK], crossfade, nodes[q])
            for k in range(n_slot):
                shown[q, k] = np.log(light[k]) - nodes[q, k, 0]
        noise[:], spread = 0.0, 1.0
        for k in range(offset[i], offset[i + 1] + 1):
            last = k == offset[i + 1]
            slopes = gradient[i, 0 if last else kind[k]]
            length = ending[i] if last else gap[k]
            told = k > offset[i] and length >= refractory and (last or inside[k])
            p = 0.0 if last else float(polarity[k])
            before = float(polarity[k - 1]) if k > offset[i] else 0.0
            start, late_0, left, speed_0, by_shift, by_refractory = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            if told:
                start = (at[k - 1] - shift + refractory) % n_slot
                level, velocity = 0.0, 0.0
                for q in sets:
                    late_0, log_now, own = _look(start, light, nodes[q], values[q], crossfade)
                    lates[0, q] = late_0
                    level, velocity = kept(refractory * own, pole)
                    added = before * told_noise * (level * noise[q, 0] + velocity * noise[q, 1])
                    reference[q] = log_now - late_0 + added
                left = told_noise**2 * (1 - level**2 * (1 - spread))
                for q in others:
                    by_level, by_velocity = kept(refractory * own, values[q, POLE])
                    added = before * values[q, NOISE] * (by_level * noise[q, 0] + by_velocity * noise[q, 1])
                    reference[q] = log_now - late_0 + added
                speed_0 = late_0 * own
                by_level, by_velocity = _change_of_kept(refractory * own, pole)
                fading = before * told_noise * (by_level * noise[0, 0] + by_velocity * noise[0, 1])
                by_shift = (
                    -late_0 * own - fading * refractory * _change_of_light(start, light, crossfade) / tau
                )
                by_refractory = fading * own - by_shift
            late, log_now, own, fired, spread_now = 0.0, 0.0, 0.0, 0.0, 1.0
            side = 0 if p > 0 else 1
            threshold = thresholds[i, side]
            slowest = SLOWEST * threshold  # not of what is told: contrasts that shrink would be ever likelier
            if not last:
                fired = (at[k] - shift) % n_slot
                for q in sets:
                    late, log_now, own = _look(fired, light, nodes[q], values[q], crossfade)
                    lates[1, q] = late
                    if told_noise > 0:
                        noise[q, 0], spread_now, noise[q, 1] = lead_of(
                            lead, told_noise, late, own, fired, nodes[q], crossfade, pole
                        )
                    met[q] = log_now - late + p * told_noise * noise[q, 0]
                    rarity[q] = _rarity(p, late + leak / own, own, slowest)
                for q in sets[:-1]:
                    if abs(noise[q, 0] - noise[0, 0]) > TURN:
                        met[q] += p * told_noise * (noise[0, 0] - noise[q, 0])
                        noise[q, 0], noise[q, 1] = noise[0, 0], noise[0, 1]
                for q in others:
                    noise[q, 0], _, noise[q, 1] = lead_of(
                        lead, values[q, NOISE], late, own, fired, nodes[0], crossfade, values[q, POLE]
                    )
                    met[q] = log_now - late + p * values[q, NOISE] * noise[q, 0]
            spread = spread_now
            if not told:
                continue
            slot_0, fade_0 = shown_at(start, late_0, light, crossfade)
            answer_0 = _answer(lates[0], values[0], moved_by)
            if not last:
                since = length - refractory
                u = p * (met[0] - reference[0] + leak * since) / threshold - 1
                by_clock = terms.clock**2 / 12 * ((late * own) ** 2 + speed_0**2)
                residual[k], variance[k] = u, (told_noise**2 * spread + left + by_clock) / threshold**2
                scale = np.sqrt(terms.scatter**2 + weigh[k])
                factor = p / threshold / scale
                row[:] = 0
                answer = _answer(lates[1], values[0], moved_by)
                slot, fade = shown_at(fired, late, light, crossfade)
                _add_light(row, factor * answer, slot, fade, leds, table, tilt, veil, band, n)
                _add_light(row, -factor * answer_0, slot_0, fade_0, leds, table, tilt, veil, band, n)
                for q in range(len(STIRRED)):
                    if moved_by[q] != 0:
                        more = met[q + 1] - met[0] - reference[q + 1] + reference[0]
                        row[timing + STIRRED[q]] = factor * more / moved_by[q]
                row[timing + SHIFT] = -factor * (late * own + by_shift)
                row[timing + REFRACTORY] = -factor * (by_refractory + leak)
                row[timing + LEAK] = factor * since
                row[logs + side] = -(u + 1) / scale
                excess = (u / scale / terms.robust) ** 2
                weight, share = 1 / (1 + excess), terms.slope_term
                cost[i] += np.log(scale) + 0.5 * terms.robust**2 * np.log(1 + excess)
                cost[i] += share * (rarity[0] + np.log(threshold))
                _add(matrix, slopes, row, weight * u / scale, weight)
                row[:] = 0
                for q in range(DARK + 1):
                    more = rarity[q + 1] - rarity[0]
                    row[timing + q] = more / moved_by[q] if moved_by[q] != 0 and abs(more) < KINK else 0.0
                factor = p / np.sqrt((late + leak / own) ** 2 + (slowest / own) ** 2)
                row[timing + LEAK] = -factor / own
                earlier = (
                    fired - EARLIER
                ) % n_slot  # by differences: v' = late own is too near to log I' for its change
                late_then, _, own_then = _look(earlier, light, nodes[0], values[0], crossfade)
                more = _rarity(p, late_then + leak / own_then, own_then, slowest) - rarity[0]
                row[timing + SHIFT] = more / EARLIER if abs(more) < KINK else 0.0
                _add_light(row, factor * answer, slot, fade, leds, table, tilt, veil, band, n)
                slot, fade = phase_at(fired, crossfade, n_slot)
                lit = 1 - values[0, DARK] / (own * tau)  # I / (I + dark)
                _add_light(row, -factor * (1 + late * lit), slot, fade, leds, table, tilt, veil, band, n)
                row[logs + side] = factor * (late + leak / own)
                _add(matrix, slopes, row, share, share)
            # thresholds that were not met: v is extreme where slots start
            n_probe = int(start + min(length - refractory, float(n_slot))) - int(start)
            for side in range(2):
                sign = 1.0 - 2.0 * side
                if p == sign:
                    continue
                far, where, since = 0.0, -1, 0.0
                for step in range(1, n_probe + 1):
                    probe = (int(start) + step) % n_slot
                    passed = int(start) + step - start
                    value = sign * (shown[0, probe] - reference[0] + leak * passed)
                    if value > far:
                        far, where, since = value, probe, passed
                threshold = thresholds[i, side]
                scale = np.sqrt(terms.scatter**2 + left / threshold**2)
                z = (1 - far / threshold) / scale
                if where < 0 or z > FAR:
                    continue
                more, slope, bend = _survival(z)
                cost[i] += more
                row[:] = 0
                factor = -sign / (threshold * scale)
                late = nodes[0, where, 0]
                for q in range(3):
                    lates[1, q] = nodes[q, where, 0]
                answer = _answer(lates[1], values[0], moved_by)
                slot, fade = shown_at(float(where), late, light, crossfade)
                _add_light(row, factor * answer, slot, fade, leds, table, tilt, veil, band, n)
                _add_light(row, -factor * answer_0, slot_0, fade_0, leds, table, tilt, veil, band, n)
                for q in range(len(STIRRED)):
                    moved = shown[q + 1, where] - shown[0, where] if q < NOISE else 0.0
                    if moved_by[q] != 0:
                        more = moved - reference[q + 1] + reference[0]
                        row[timing + STIRRED[q]] = factor * more / moved_by[q]
                row[timing + SHIFT] = -factor * by_shift
                row[timing + REFRACTORY] = -factor * (by_refractory + leak)
                row[timing + LEAK] = factor * since
                row[logs + side] = far / (threshold * scale)
                _add(matrix, slopes, row, slope, bend)
        for a in range(n_all):
            for b in range(a):
                matrix[b, a] = matrix[a, b]
