"""Events from frames, as ESIM makes them (Rebecq et al. 2018): log(I + eps) is linear in time between two frames.

Written for this benchmark alone: it shares nothing with the pixel of `evsdr.simulate`.
"""

import numpy as np
from numba import njit

from evsdr import Events

EPS = 1e-3  # ESIM's
FRAMES_PER_SLOT = 16
SMALLEST = 0.02  # threshold that noise leaves


def make_events(
    signal: np.ndarray,
    constant_light: float,
    order: np.ndarray,
    slot_us: float,
    rounds: int,
    threshold: float,
    noise: float,
    refractory_us: float,
    seed: int,
) -> Events:
    """Show a schedule whose lights fade linearly into each other all the while.

    Parameters
    ----------
    signal : (n_light, H, W) float
        Frames of single lights.
    constant_light : float
        Added to each frame.
    order : (n_slot,) int
        Light of each slot, -1 for none.
    noise : float
        Relative standard deviation of the threshold; drawn anew, evenly, for each event.
    refractory_us : float
        After an event until the pixel memorises its light anew: what changes meanwhile is lost.
    """
    n_light, height, width = signal.shape
    flat = np.vstack([signal.reshape(n_light, -1), np.zeros((1, height * width))]).astype(np.float64)
    log_light = np.log(slot_frames(flat[order], FRAMES_PER_SLOT) + constant_light + EPS)
    step_us = slot_us / FRAMES_PER_SLOT
    arguments = step_us, rounds, threshold, noise * np.sqrt(3.0), refractory_us
    log_light = np.ascontiguousarray(log_light.T)
    parts = [_watch(level, *arguments, seed * 7919 + i) for i, level in enumerate(log_light)]
    t = np.concatenate([t for t, _ in parts])
    p = np.concatenate([p for _, p in parts])
    pixel = np.repeat(np.arange(height * width), [len(t) for t, _ in parts])
    first = np.lexsort((pixel, t))
    t, p, pixel = t[first], p[first], pixel[first]
    return Events((pixel % width).astype(np.uint16), (pixel // width).astype(np.uint16), p, t)


def slot_frames(light: np.ndarray, per_slot: int) -> np.ndarray:
    """Give the frames (n_slot * per_slot, n_pixel) of one round from the light (n_slot, n_pixel) at starts of slots."""
    share = np.arange(per_slot)[:, None] / per_slot
    after = np.roll(light, -1, axis=0)
    return np.concatenate([(1 - share) * a + share * b for a, b in zip(light, after)])


@njit(cache=True)
def _watch(level, step_us, rounds, threshold, half_width, refractory_us, seed):
    """Give times [us] and polarities of one pixel's events; `level` is its log light in each frame of a round."""
    np.random.seed(seed)
    n = len(level)
    t_out, p_out = [np.int64(0)][:0], [np.int8(0)][:0]
    reference, awake = level[0], 0.0
    bar = max(threshold * (1 + half_width * np.random.uniform(-1.0, 1.0)), SMALLEST)
    for k in range(rounds * n):
        start, a, b = k * step_us, level[k % n], level[(k + 1) % n]
        slope = (b - a) / step_us
        if awake >= start + step_us:
            continue
        if awake > start:
            reference = a + slope * (awake - start)
        while slope != 0.0:
            goal = reference + (bar if slope > 0 else -bar)
            t = start + (goal - a) / slope
            if t >= start + step_us:
                break
            t_out.append(np.int64(np.floor(t + 0.5)))
            p_out.append(np.int8(1 if slope > 0 else 0))
            bar = max(threshold * (1 + half_width * np.random.uniform(-1.0, 1.0)), SMALLEST)
            awake = t + refractory_us
            if awake >= start + step_us:
                break
            reference = a + slope * (awake - start)
    return np.array(t_out), np.array(p_out)
