"""The likelihood of first passage by brute force: one pixel, plain NumPy in float64, on a fine grid of phases."""

import numpy as np
from scipy.special import log_ndtr


class Pixel:
    """A pixel under a ring that fades linearly from slot to slot.

    Parameters
    ----------
    light : (n_slot,) float
        I at the start of each slot; the first follows the last.
    on, off : float
        Mean thresholds.
    noise : float
        Relative standard deviation of the thresholds.
    """

    def __init__(self, light, on, off, noise):
        self.light, self.on, self.off, self.noise = np.asarray(light, float), on, off, noise

    def log_light(self, phase):
        """Give log I at phases that go on counting over the rounds."""
        return np.log(self._mixed(phase))

    def _mixed(self, phase):
        slot = np.floor(phase).astype(int)
        n = len(self.light)
        fade = phase - slot
        return (1 - fade) * self.light[slot % n] + fade * self.light[(slot + 1) % n]

    def speed(self, phase):
        """Give d log I / d phase."""
        slot = np.floor(phase).astype(int)
        n = len(self.light)
        return (self.light[(slot + 1) % n] - self.light[slot % n]) / self._mixed(phase)

    def excursions(self, start, end):
        """Give the largest excursion of log I upward and downward from `start` until a slot starts for the last time."""
        passed = np.arange(np.floor(start) + 1, np.floor(end) + 1)
        change = self.log_light(np.append(start, passed)) - self.log_light(start)
        return change.max(), -change.min()

    def log_density(self, start, end, polarity):
        """Give the logarithm of the density of an event at the phase `end`, of the reference memorised at `start`."""
        change = polarity * (self.log_light(end) - self.log_light(start))
        up, down = self.excursions(start, end)
        own, other = (up, down) if polarity > 0 else (down, up)
        mine, others = (self.on, self.off) if polarity > 0 else (self.off, self.on)
        speed = polarity * self.speed(end)
        if change < own or speed <= 0:
            return -np.inf
        u = (change / mine - 1) / self.noise
        log_normal = -0.5 * u**2 - np.log(np.sqrt(2 * np.pi) * self.noise * mine)
        return log_normal + np.log(speed) + log_ndtr((1 - other / others) / self.noise)

    def log_silence(self, start, end):
        """Give the logarithm of the probability that no event fires from `start` to `end`."""
        up, down = self.excursions(start, end)
        last = self.log_light(end) - self.log_light(start)
        up, down = max(up, last), max(down, -last)
        return sum(log_ndtr((1 - x / c) / self.noise) for x, c in ((up, self.on), (down, self.off)))
