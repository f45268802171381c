"""What a slow photoreceptor makes of the ring's light, with a dark current.

    tau / (I + I_dark) dv/dt = log I - v

The lag d = log I - v is followed from node to node; between two nodes log I is a parabola in the receptor's own time
INT (I + I_dark) / tau dt, to which d answers in closed form. Times are in slots.
"""

import numpy as np
from numba import njit

NODE = 0.15  # change of log I between two nodes
MOST_NODES = 40  # of a ramp
# Columns of what `follow` writes, and the one of log I's change over the ramp
N_COLUMN, RISE = MOST_NODES + 3, MOST_NODES + 2
N_BEFORE = 8  # slots in which the lag settles before the first one


@njit(cache=True, error_model="numpy")
def _step(late, light, light_then, change, duration, slope, tau, dark):
    """Give log I - v after a part of a ramp, over which log I changes by `change`."""
    own = duration * (0.5 * (light + light_then) + dark) / tau
    if own <= 0:
        return late
    gone = -np.expm1(-own)
    bend = slope * tau * (1 / (light_then * (light_then + dark)) - 1 / (light * (light + dark))) / own
    start = change / own - 0.5 * bend * own
    return late * (1 - gone) + start * gone + bend * (own - gone)


@njit(cache=True)
def _n_node(rise):
    return min(1 + int(abs(rise) / NODE), MOST_NODES)


@njit(cache=True, error_model="numpy")
def follow(light, tau, dark, crossfade, nodes):
    """Follow the lag over a round.

    Parameters
    ----------
    light : (n_slot,) float64
        I with each slot's LED fully lit.
    tau, dark, crossfade : float
    nodes : (n_slot, N_COLUMN) float64
        Written: log I - v where each slot starts, and at the nodes of its ramp from the start of that on; then by how much
        log I changes over the ramp.
    """
    n_slot, late = len(light), 0.0
    for k in range(-min(N_BEFORE, n_slot), n_slot):
        start, then = light[k % n_slot], light[(k + 1) % n_slot]
        nodes[k % n_slot, 0] = late
        late *= np.exp(-(1 - crossfade) * (start + dark) / tau)
        nodes[k % n_slot, 1] = late
        if crossfade == 0:
            late += np.log(then / start)
            continue
        rise, slope = np.log(then / start), (then - start) / crossfade
        n = _n_node(rise)
        nodes[k % n_slot, RISE] = rise
        each, ratio, here = rise / n, np.exp(rise / n), start
        for i in range(n):
            there = here * ratio
            duration = (there - here) / slope if slope != 0 else crossfade
            late = _step(late, here, there, each, duration, slope, tau, dark)
            nodes[k % n_slot, 2 + i] = late
            here = there


@njit(cache=True, error_model="numpy")
def late_at(at, light, tau, dark, crossfade, nodes):
    """Give log I - v at a position (slot + the fraction of it that is over)."""
    n_slot = len(light)
    slot = min(int(at), n_slot - 1)
    past, start, then = at - slot, light[slot], light[(slot + 1) % n_slot]
    if past <= 1 - crossfade or crossfade == 0:
        return nodes[slot, 0] * np.exp(-past * (start + dark) / tau)
    fade = (past - (1 - crossfade)) / crossfade
    now, slope, rise = start + fade * (then - start), (then - start) / crossfade, nodes[slot, RISE]
    if slope == 0 or rise == 0:
        return nodes[slot, 1] * np.exp(-fade * crossfade * (start + dark) / tau)
    n, risen = _n_node(rise), np.log(now / start)
    i = min(max(int(risen * n / rise), 0), n - 1)
    before = i * rise / n
    here = start * np.exp(before)
    return _step(nodes[slot, 1 + i], here, now, risen - before, (now - here) / slope, slope, tau, dark)


@njit(cache=True, error_model="numpy")
def phase_at(at, crossfade, n_slot):
    """Give slot and fade at a position."""
    slot = min(int(at), n_slot - 1)
    past = at - slot - (1 - crossfade)
    return slot, min(past / crossfade, 1.0) if past > 0 and crossfade > 0 else 0.0


@njit(cache=True, error_model="numpy")
def light_at(at, light, crossfade):
    """Give I at a position."""
    slot, fade = phase_at(at, crossfade, len(light))
    return light[slot] + fade * (light[(slot + 1) % len(light)] - light[slot])


@njit(cache=True, error_model="numpy")
def own_rate(at, light, tau, dark, crossfade):
    """Give the rate of a receptor's own time at a position."""
    return (light_at(at, light, crossfade) + dark) / tau


@njit(cache=True, error_model="numpy")
def shown_at(at, late, light, crossfade):
    """Give slot and fade at which the light was exp(v), what is shown at a position.

    As v passes through all the light between, at a hard switch it shows that of a crossfade.
    """
    n_slot = len(light)
    slot, reached = phase_at(at, crossfade, n_slot)
    end = light[slot] + reached * (light[(slot + 1) % n_slot] - light[slot])
    shown = end * np.exp(-late)
    nearest, best_slot, best_fade = np.inf, slot, reached
    for back in range(min(N_BEFORE, n_slot)):
        k = (slot - back) % n_slot
        start = light[k]
        low, high = min(start, end), max(start, end)
        if low <= shown <= high:
            share = (shown - start) / (end - start) if end != start else 1.0
            return k, reached * share
        away = max(low - shown, shown - high)
        if away < nearest:  # by rounding, and by what a parabola leaves
            nearest, best_slot = away, k
            best_fade = reached if abs(end - shown) < abs(start - shown) else 0.0
        end, reached = start, 1.0
    return best_slot, best_fade
