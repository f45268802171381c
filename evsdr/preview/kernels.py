"""Loops over pixels and their events, quick enough for many maps a second; `decoder` says what these are."""

import numpy as np
from numba import njit

PRIOR = 1e-4  # (0.01 / 1)^2: noise of a pair over spread of log R; measured: 1e-3 and more are worse
SPREAD = 0.2  # of misfits, in log light; measured: half of it is as good
DAMPING = 1e-2  # of Levenberg and Marquardt, to start with, relative to the diagonal; guessed
REFLECTANCE = np.log(0.3)  # where nothing tells
STEEPEST = 8.0  # slope, 83 degrees
LONGEST = 1.0  # step of a slope or a log reflectance


@njit(cache=True, error_model="numpy", fastmath=True)
def led_signals(theta, light, band, softness, out):
    """Give A_j (n_led, 3) with its derivatives by p and q; that by the log reflectance is A_j itself.

    As `model.lambert.LambertianRing`, for one pixel.
    """
    p, q = theta[0], theta[1]
    inv = 1 / np.sqrt(1 + p * p + q * q)
    nx, ny, nz = -p * inv, -q * inv, inv
    gain = np.exp(theta[2:])
    for j in range(len(band)):
        vx, vy, vz = light[j, 0], light[j, 1], light[j, 2]
        along = nx * vx + ny * vy + nz * vz
        root = np.sqrt(along * along + softness * softness * (vx * vx + vy * vy + vz * vz)) + 1e-12
        half = 0.5 * gain[band[j]]
        slope = half * (1 + along / root) * inv
        out[j, 0] = half * (along + root)
        out[j, 1] = slope * (along * nx - vx)
        out[j, 2] = slope * (along * ny - vy)


@njit(cache=True, error_model="numpy", fastmath=True)
def list_pairs(p, t, on, off, rest, clock, n_slot, crossfade, slot, fade, change):
    """List the pairs of a pixel: slot and fade (n, 2) when the reference was memorised and when it fired; the change.

    Of a pair, log I(t_k) - log I(t_(k-1) + refractory) = p_k C.
    """
    per_us = 1 / clock[1]
    for k in range(1, len(t)):
        change[k - 1] = on if p[k] > 0 else -off
        for side in range(2):
            time = t[k] if side else min(t[k - 1] + rest, t[k])
            at = (time - clock[0]) * per_us
            whole = np.floor(at)
            slot[k - 1, side] = np.int64(whole - n_slot * np.floor(whole / n_slot))
            fade[k - 1, side] = 0.0 if crossfade == 0 else max((at - whole - 1 + crossfade) / crossfade, 0.0)


@njit(cache=True, error_model="numpy", fastmath=True)
def light_at(slot, fade, order, signal, constant):
    """Give the light at a phase, and the LEDs that fade out and in, -1 for none."""
    old, new = order[slot], order[slot + 1 if slot + 1 < len(order) else 0]
    total = constant
    if old >= 0:
        total += (1 - fade) * signal[old, 0]
    if new >= 0:
        total += fade * signal[new, 0]
    return total, old, new


@njit(cache=True, error_model="numpy", fastmath=True)
def equations(slot, fade, change, order, band, constant, signal, theta, matrix, right):
    """Fill the normal equations (lower triangle) of a pixel, from its pairs; gives the cost, as `misfit`.

    Misfits count by the law of Geman and McClure 1987, of width `SPREAD`.
    """
    n = len(theta)
    lit, place, share = np.empty(4, np.int64), np.empty(4, np.int64), np.empty(4)
    matrix[:], right[:], cost = 0.0, 0.0, 0.0
    for a in range(2, n):
        apart = REFLECTANCE - theta[a]
        matrix[a, a], right[a] = PRIOR, PRIOR * apart
        cost += PRIOR * apart * apart
    for k in range(len(change)):
        before, i1, i2 = light_at(slot[k, 0], fade[k, 0], order, signal, constant)
        after, j1, j2 = light_at(slot[k, 1], fade[k, 1], order, signal, constant)
        residual = change[k] - np.log(after / before)
        near = 1 / (1 + (residual / SPREAD) ** 2)
        cost += near * residual * residual
        weight = near * near
        lit[0], lit[1], lit[2], lit[3] = j1, j2, i1, i2
        share[0], share[1] = (1 - fade[k, 1]) / after, fade[k, 1] / after
        share[2], share[3] = (fade[k, 0] - 1) / before, -fade[k, 0] / before
        n_lit = 4
        if slot[k, 0] == slot[k, 1]:
            share[0], share[1], n_lit = share[0] + share[2], share[1] + share[3], 2
        by_p, by_q = 0.0, 0.0
        for a in range(n_lit):
            j = lit[a]
            if j < 0:
                place[a], share[a] = 2, 0.0
                continue
            by_p += share[a] * signal[j, 1]
            by_q += share[a] * signal[j, 2]
            place[a], share[a] = 2 + band[j], share[a] * signal[j, 0]
        right[0] += weight * by_p * residual
        right[1] += weight * by_q * residual
        matrix[0, 0] += weight * by_p * by_p
        matrix[1, 0] += weight * by_p * by_q
        matrix[1, 1] += weight * by_q * by_q
        for a in range(n_lit):
            heavy = weight * share[a]
            right[place[a]] += heavy * residual
            matrix[place[a], 0] += heavy * by_p
            matrix[place[a], 1] += heavy * by_q
            for b in range(n_lit):
                matrix[place[a], place[b]] += heavy * share[b]
    return cost


@njit(cache=True, error_model="numpy", fastmath=True)
def misfit(slot, fade, change, order, constant, signal, theta):
    """Give what `equations` make least."""
    cost = PRIOR * np.sum((theta[2:] - REFLECTANCE) ** 2)
    for k in range(len(change)):
        before = light_at(slot[k, 0], fade[k, 0], order, signal, constant)[0]
        after = light_at(slot[k, 1], fade[k, 1], order, signal, constant)[0]
        residual = change[k] - np.log(after / before)
        cost += residual * residual / (1 + (residual / SPREAD) ** 2)
    return cost


@njit(cache=True, error_model="numpy", fastmath=True)
def solve_damped(matrix, right, damping, lower, step):
    """Solve (M + damping diag M) step = right by Cholesky's decomposition; only the lower triangle of M is read."""
    n = len(right)
    for a in range(n):
        for b in range(a + 1):
            value = matrix[a, b] * (1 + damping) + 1e-9 if a == b else matrix[a, b]
            for c in range(b):
                value -= lower[a, c] * lower[b, c]
            lower[a, b] = np.sqrt(max(value, 1e-12)) if a == b else value / lower[b, b]
    for a in range(n):
        value = right[a]
        for c in range(a):
            value -= lower[a, c] * step[c]
        step[a] = value / lower[a, a]
    for a in range(n - 1, -1, -1):
        value = step[a]
        for c in range(a + 1, n):
            value -= lower[c, a] * step[c]
        step[a] = value / lower[a, a]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def solve_pixels(
    pixels,
    offset,
    p,
    t,
    on,
    off,
    rest,
    clock,
    light,
    order,
    band,
    crossfade,
    constant,
    softness,
    n_step,
    theta,
):
    """Move the unknowns of some pixels towards what explains their events best, by a few damped steps.

    Parameters
    ----------
    pixels : (n,) int
    offset, p, t
        Events sorted by pixel, see `events.pair_kernel.sort_by_pixel`.
    on, off : (n_pixel) float
        Thresholds.
    rest : float
        Refractory period [us].
    clock : (start of a round, length of a slot) [us]
    light : (n_pixel or 1, n_led, 3) float
        Irradiance times direction.
    order, band, crossfade, constant
        LED of each slot, band of each LED, see `Schedule`; C_w, above 0.
    softness : float
        Of the horizon, see `model.lambert.soft_max0`.
    n_step : int
    theta : (n_pixel, 2 + n_band) float
        Slopes and log reflectances: where to start, and what is found.
    """
    n, most = theta.shape[1], np.max(offset[1:] - offset[:-1])
    slots, fades, changes = np.empty((most, 2), np.int64), np.empty((most, 2)), np.empty(most)
    signal = np.empty((len(band), 3))
    matrix, lower = np.empty((n, n)), np.empty((n, n))
    right, step, trial = np.empty(n), np.empty(n), np.empty(n)
    for i in pixels:
        first, last = offset[i], offset[i + 1]
        slot, fade, change = slots[: last - first - 1], fades[: last - first - 1], changes[: last - first - 1]
        list_pairs(
            p[first:last],
            t[first:last],
            on[i],
            off[i],
            rest,
            clock,
            len(order),
            crossfade,
            slot,
            fade,
            change,
        )
        at, damping = light[i % len(light)], DAMPING
        for _ in range(n_step):
            led_signals(theta[i], at, band, softness, signal)
            cost = equations(slot, fade, change, order, band, constant, signal, theta[i], matrix, right)
            solve_damped(matrix, right, damping, lower, step)
            for a in range(n):
                trial[a] = theta[i, a] + min(max(step[a], -LONGEST), LONGEST)
            for a in range(2):
                trial[a] = min(max(trial[a], -STEEPEST), STEEPEST)
            led_signals(trial, at, band, softness, signal)
            if misfit(slot, fade, change, order, constant, signal, trial) <= cost:
                theta[i] = trial
                damping *= 0.3
            else:
                damping = max(damping, DAMPING) * 10
