"""An event pixel by brute force: its equations in steps of a microsecond by Runge and Kutta's fourth order, in NumPy.

Shares no code with `evsdr`: schedule, LEDs, photoreceptor, comparators and noise are written from their equations,

    dL/dt = (lit(t) - L) / rise,    dv/dt = 2 pi cutoff L (log L - v),    fire at v + noise - memorised + leak t = on, -off.
"""

from typing import NamedTuple

import numpy as np

NODE = 0.5  # time constants between which noise is linear: part of what the simulated pixel is


class Seen(NamedTuple):
    """What comparators see of some pixels; times are double where light jumps."""

    t_us: np.ndarray  # (n,)
    log_light: np.ndarray  # (n, n_pixel): v, or log L without a photoreceptor
    own_time: np.ndarray  # (n, n_pixel): time in time constants


def watch(signal, veil, order, slot_us, crossfade, n_round, cutoff_hz=0.0, rise_us=0.0, step_us=1.0) -> Seen:
    """Integrate LEDs and photoreceptors of signals (n_led, n_pixel); slots are whole numbers of steps."""
    n, rate = round(slot_us / step_us), 2e-6 * np.pi * cutoff_hz
    fade = np.zeros(2 * n + 1)
    if crossfade:
        fade = np.clip((np.arange(2 * n + 1) / (2 * n) - 1 + crossfade) / crossfade, 0, 1)

    def lit_by(k):
        led = order[k % len(order)]
        return veil + (signal[led] if led >= 0 else 0 * signal[0])

    light, seen, passed = lit_by(0), np.log(lit_by(0)), np.zeros(signal.shape[1])
    times, paths, own = [], [], []
    for k in range(n_round * len(order)):
        lit = lit_by(k) + fade[:, None] * (lit_by(k + 1) - lit_by(k))  # twice a step
        if not rise_us:
            light = lit[0]
        if not rate:
            seen = np.log(light)
        path, clock = [seen], [passed]
        log_lit = np.log(lit)
        for i in range(0, 2 * n, 2):
            if rise_us:
                now = light
                light, middle = _rise(now, lit[i : i + 3], rise_us, step_us)
                stages = (now, np.log(now)), (middle, np.log(middle)), (light, np.log(light))
            else:
                stages = tuple(zip(lit[i : i + 3], log_lit[i : i + 3]))
            seen = _answer(seen, stages, rate, step_us) if rate else stages[2][1]
            passed = passed + rate * step_us / 6 * (stages[0][0] + 4 * stages[1][0] + stages[2][0])
            path.append(seen)
            clock.append(passed)
        light = light if rise_us else lit[-1]
        times.append(k * slot_us + step_us * np.arange(n + 1))
        paths.append(path)
        own.append(clock)
    return Seen(np.concatenate(times), np.concatenate(paths), np.concatenate(own))


def _rise(light, lit, rise_us, step_us):
    """Give the light of LEDs after a step, and in its middle by the cubic through both ends."""
    a = (lit[0] - light) / rise_us
    b = (lit[1] - light - 0.5 * step_us * a) / rise_us
    c = (lit[1] - light - 0.5 * step_us * b) / rise_us
    d = (lit[2] - light - step_us * c) / rise_us
    then = light + step_us / 6 * (a + 2 * b + 2 * c + d)
    return then, 0.5 * (light + then) + step_us / 8 * (a - (lit[2] - then) / rise_us)


def _answer(v, stages, rate, step_us):
    """Give v after a step; stages are light and its logarithm at begin, middle and end."""
    (now, log_now), (middle, log_middle), (then, log_then) = stages
    a = rate * now * (log_now - v)
    b = rate * middle * (log_middle - v - 0.5 * step_us * a)
    c = rate * middle * (log_middle - v - 0.5 * step_us * b)
    d = rate * then * (log_then - v - step_us * c)
    return v + step_us / 6 * (a + 2 * b + 2 * c + d)


def draw_noise(own_time, sigma, rng):
    """Draw the noise (n,) of a photoreceptor at its own times (n,): correlated by exp(-time) between its nodes."""
    fresh = sigma * rng.standard_normal(int(own_time[-1] / NODE) + 2)
    kept, noise = np.exp(-NODE), [fresh[0]]
    for value in fresh[1:] * np.sqrt(1 - kept**2):
        noise.append(kept * noise[-1] + value)
    return np.interp(own_time, NODE * np.arange(len(noise)), noise)


def fire(t_us, path, on, off, refractory_us=0.0, leak_per_us=0.0, event_noise=0.0, rng=None):
    """Give times and polarities of the events of one pixel whose comparators see a path (n,), linear between its times."""

    def thresholds():
        return (
            (on, off) if not event_noise else np.array([on, off]) * (1 + event_noise * rng.standard_normal(2))
        )

    times, polarities = [], []
    i, since, memorised, (now_on, now_off) = 1, t_us[0], path[0], thresholds()
    while i < len(t_us):
        some = slice(i, i + 2000)
        q = path[some] - memorised + leak_per_us * (t_us[some] - since)
        beyond = np.flatnonzero((q >= now_on) | (q <= -now_off))
        if not len(beyond):
            i += 2000
            continue
        j, q = i + beyond[0], q[beyond[0]]
        p, goal = (1, now_on) if q > 0 else (-1, -now_off)
        begin, before = since, 0.0
        if t_us[j - 1] > since:
            begin = t_us[j - 1]
            before = path[j - 1] - memorised + leak_per_us * (begin - since)
        t = begin + (t_us[j] - begin) * (goal - before) / (q - before)
        times.append(t)
        polarities.append(p)
        since = t + refractory_us
        if since >= t_us[-1]:
            break
        i = int(np.searchsorted(t_us, since, "right"))
        if t_us[j] == t_us[j - 1] and not refractory_us:  # at a jump: what follows it is memorised
            i = j + 1
        part = (since - t_us[i - 1]) / (t_us[i] - t_us[i - 1]) if t_us[i] > t_us[i - 1] else 1.0
        memorised = path[i - 1] + part * (path[i] - path[i - 1])
        now_on, now_off = thresholds()
    return np.array(times), np.array(polarities, int)
