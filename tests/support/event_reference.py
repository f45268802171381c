"""An event pixel by brute force: tiny steps of time, one pixel after the other, in plain NumPy and Python."""

import numpy as np

DARKNESS = 1e-6


def led_weights(t_us, order, slot_us, crossfade, n_led):
    """Give the weights (n_time, n_led) of the LEDs straight from the words of the schedule."""
    weight = np.zeros((len(t_us), n_led))
    for i, t in enumerate(t_us):
        k = int(t // slot_us)
        before_next = slot_us - (t - k * slot_us)
        fade = 0.0
        if before_next < crossfade * slot_us:
            fade = 1 - before_next / (crossfade * slot_us)
        for led, part in ((order[k % len(order)], 1 - fade), (order[(k + 1) % len(order)], fade)):
            if led >= 0:
                weight[i, led] += part
    return weight


def light_path(t_us, signal, constant_light, order, slot_us, crossfade, led_rise_us=0.0):
    """Give I (n_time, n_pixel) for signal (n_led, n_pixel) at evenly spaced times."""
    weight = led_weights(t_us, order, slot_us, crossfade, len(signal))
    if led_rise_us:
        gain = 1 - np.exp(-(t_us[1] - t_us[0]) / led_rise_us)
        settled = [weight[0]]
        for target in _between(weight, jumps=crossfade == 0):
            settled.append(settled[-1] + gain * (target - settled[-1]))
        weight = np.array(settled)
    return np.maximum(weight @ signal + constant_light, DARKNESS)


def lagged_path(t_us, light, cutoff_hz, jumps):
    """Give the low-passed log I (n_time, n_pixel); `jumps` where the light is a staircase."""
    own_time = 2e-6 * np.pi * cutoff_hz * _between(light, jumps) * (t_us[1] - t_us[0])
    lagged = [np.log(light[0])]
    for target, kept in zip(_between(np.log(light), jumps), np.exp(-own_time)):
        lagged.append(target + kept * (lagged[-1] - target))
    return np.array(lagged)


def _between(values, jumps):
    """Give the values that hold between the times of a grid that has the jumps on it."""
    return values[:-1] if jumps else 0.5 * (values[:-1] + values[1:])


def find_events(t_us, path, on, off, refractory_us, leak_per_us=0.0):
    """Give times and polarities of the events of one pixel whose log intensity is `path` (n_time,)."""
    times, polarities = [], []
    t_reference, reference = 0.0, path[0]
    ready = 0.0
    for i in range(1, len(t_us)):
        t0, t1 = t_us[i - 1], t_us[i]
        while True:
            if ready > t1:
                break
            if ready > t_reference:
                part = (ready - t0) / (t1 - t0)
                t_reference, reference = ready, path[i - 1] + part * (path[i] - path[i - 1])
            begin = max(t0, t_reference)
            q0 = path[i - 1] + (begin - t0) / (t1 - t0) * (path[i] - path[i - 1]) - reference
            q0 += leak_per_us * (begin - t_reference)
            q1 = path[i] - reference + leak_per_us * (t1 - t_reference)
            if -off < q1 < on:
                break
            polarity = 1 if q1 >= on else -1
            goal = on if polarity > 0 else -off
            t = begin + (goal - q0) / (q1 - q0) * (t1 - begin)
            times.append(t)
            polarities.append(polarity)
            ready = t + refractory_us
    return np.array(times), np.array(polarities, int)
