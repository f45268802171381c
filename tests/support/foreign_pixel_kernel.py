"""One event pixel by small steps of time: the inner loop of `foreign_pixel`, which tells the physics."""

import numpy as np
from numba import njit, prange

NEVER = 1e300
FAR = 40.0  # exponent from which a touch between two steps is out of the question


@njit(cache=True)
def draw_threshold(mean, pixel):
    """Draw a threshold for the next event: Gaussian, or uniform of the same standard deviation."""
    if pixel.event_noise == 0:
        return mean
    spread = np.random.uniform(-np.sqrt(3.0), np.sqrt(3.0)) if pixel.uniform else np.random.normal()
    return max(mean * (1 + pixel.event_noise * spread), 0.0)


@njit(cache=True)
def draw_delay(light, pixel):
    """Draw how late an event leaves the pixel; delay and jitter grow in the dark."""
    if pixel.latency_us == 0 and pixel.jitter_us == 0:
        return 0.0
    dim = 1 + pixel.delay_doubles_at / light
    return max(dim * (pixel.latency_us + pixel.jitter_us * np.random.normal()), 0.0)


@njit(cache=True)
def first_touch(start, end, up, down, variance):
    """Give share of the step and sign of the first threshold that a path from start to end meets, or (2, 0).

    Between its ends a path of Brownian motion meets a level beyond both with the probability
    exp(-2 d_start d_end / variance) (Borodin and Salminen 2002, 1.1.8).
    """
    if end >= up:
        return (up - start) / (end - start) if start < up else 0.0, 1
    if end <= down:
        return (down - start) / (end - start) if start > down else 0.0, -1
    if variance > 0:
        for level, sign in ((up, 1), (down, -1)):
            exponent = 2 * (level - start) * (level - end) / variance
            if exponent < FAR and np.random.random() < np.exp(-exponent):
                return 0.5, sign
    return 2.0, 0


@njit(cache=True)
def receive(receptor, light, step_us, pixel):
    """Give what a photoreceptor holds after a step in steady light, and the variance of its noise in it.

    White noise of the density 1 / (photons I) through one pole: Ornstein and Uhlenbeck's process.
    """
    target = np.log(light)
    if pixel.tau_us == 0:
        return target, 0.0
    speed = (light + pixel.lag_light) / pixel.tau_us
    kept = np.exp(-speed * step_us)
    receptor = target + kept * (receptor - target)
    if pixel.photons_per_us == 0:
        return receptor, 0.0
    variance = 0.5 * speed * (1 - kept * kept) / (pixel.photons_per_us * light)
    return receptor + np.sqrt(variance) * np.random.normal(), variance


@njit(cache=True)
def append(out, n, t_us, polarity):
    """Write an event where there is room, and give how many there are."""
    if n < len(out):
        out[n, 0], out[n, 1] = t_us, polarity
    return n + 1


@njit(cache=True)
def run_pixel(pixel, signal, dark, ring, step_us, n_step, on, off, noise_rates, out):
    """Run one pixel from a settled start; writes (time, polarity) into `out` and gives how many there were.

    `signal` (n_led + 1,) ends with 0, which stands for no LED; `ring` holds two LEDs for each step of a
    round, and the weight of the second.
    """
    now, then, fade = ring
    light = dark + signal[now[0]]
    level = receptor = np.log(light)  # behind the source follower, behind the photoreceptor
    walk, walks = 0.0, pixel.walk_shot > 0 or pixel.walk_floor > 0  # Brownian, and what leaks
    reference, ready, resting = level, 0.0, False
    on_now, off_now = draw_threshold(on, pixel), draw_threshold(off, pixel)
    noise_rate = noise_rates[0] + noise_rates[1]
    next_noise = np.random.exponential(1 / noise_rate) if noise_rate > 0 else NEVER
    n = 0
    for i in range(n_step):
        begin, end, start = i * step_us, (i + 1) * step_us, level + walk
        k = i % len(fade)
        light = dark + (1 - fade[k]) * signal[now[k]] + fade[k] * signal[then[k]]
        receptor, variance = receive(receptor, light, step_us, pixel)
        if pixel.follower_us > 0:
            level = receptor + np.exp(-step_us / pixel.follower_us) * (level - receptor)
            variance = 0.0  # its paths are smooth
        else:
            level = receptor
        if walks:
            strength = pixel.walk_shot * np.sqrt(light - pixel.dark_light) / light + pixel.walk_floor
            variance += strength * strength * step_us
            walk += strength * np.sqrt(step_us) * np.random.normal()
        walk += (pixel.leak_per_us + pixel.leak_of_light * (light - pixel.dark_light)) * step_us
        after = level + walk

        while next_noise < end:
            if next_noise >= ready and np.random.random() < 1 + (pixel.noise_at_white - 1) * min(light, 1.0):
                n = append(out, n, next_noise, 1 if np.random.random() * noise_rate < noise_rates[0] else -1)
                if pixel.noise_resets:
                    ready, resting = next_noise + pixel.refractory_us, True
            next_noise += np.random.exponential(1 / noise_rate)

        while True:
            if resting or not pixel.drops:
                if ready >= end:
                    break
                if ready > begin:
                    start += (ready - begin) / (end - begin) * (after - start)
                    begin = ready
            if resting:
                reference, resting = start, False
            up, down = reference + on_now, reference - off_now
            part, sign = first_touch(start, after, up, down, variance * (end - begin) / step_us)
            if sign == 0:
                break
            begin += part * (end - begin)
            start = start if part == 0 else up if sign > 0 else down
            stamp = begin + draw_delay(light, pixel)
            if begin >= ready:
                n = append(out, n, stamp, sign)
                ready = stamp + pixel.refractory_us
            if pixel.steps:
                reference = up if sign > 0 else down
            else:
                resting = True
            on_now, off_now = draw_threshold(on, pixel), draw_threshold(off, pixel)
    return n


@njit(parallel=True, cache=True)
def run_pixels(pixel, signal, dark, ring, step_us, n_step, on, off, noise_rates, seed, out):
    """Run pixels of `signal` (n_pixel, n_led + 1); `out` (n_pixel, most, 2); gives how many each had."""
    count = np.zeros(len(signal), np.int64)
    for i in prange(len(signal)):
        np.random.seed(seed + i)  # of this thread, so that threads don't matter
        rates = noise_rates[i]
        count[i] = run_pixel(pixel, signal[i], dark, ring, step_us, n_step, on[i], off[i], rates, out[i])
    return count


@njit(cache=True)
def read_out(t_us, per_event_us, patience_us):
    """Give when each event, in order of time, passes a bus one after the other; NEVER where it is lost."""
    passed = np.empty(len(t_us))
    free = 0.0
    for i, t in enumerate(t_us):
        begin = max(t, free)
        if begin - t > patience_us:
            passed[i] = NEVER
        else:
            passed[i] = free = begin + per_event_us
    return passed
