"""After which time the events of a recording come again: the length of a round, for whoever does not know it."""

import numpy as np

from evsdr.records import Events

LONGEST_US = 20_000_000  # of a recording that is looked at
MOST_BINS, FINEST_US = 1 << 13, 500.0  # of time; finer ones are noisier
FEWEST_BINS = 16
PARTS = 6  # of the image, along each side: LEDs that light it as brightly from elsewhere differ
FARTHEST = 0.6  # of the recording, to which it is compared with itself
NEAR = 2  # bins by which a time may be off
CLEAR = 6.0  # times the scatter of chance: none of 1000 correlations is that large
REPEATS = 0.3  # correlation from which events are said to come again; measured: 0.7 and more under rings
ALIKE = 0.85  # of the best correlation, from which a shorter time counts as well; guessed


class Repetition:
    """How far events come again after any time: the autocorrelation of their rates in parts of the image.

    Parameters
    ----------
    events : Events
    shape : (height, width)
        Of the sensor.

    Attributes
    ----------
    duration_us, bin_us : float
        Of what is looked at, and of the steps of time.
    alike : (n_lag,) float
        Correlation, 1 after no time at all; that events are counted is taken off.
    """

    def __init__(self, events: Events, shape: tuple[int, int]):
        begin = int(events.t[0])
        n_event = int(np.searchsorted(events.t, begin + LONGEST_US))
        self.duration_us = float(events.t[n_event - 1] - begin) + 1
        self.bin_us = max(self.duration_us / MOST_BINS, FINEST_US)
        n = int(self.duration_us / self.bin_us) + 1
        y, x = (a[:n_event].astype(np.int64) * PARTS // size for a, size in zip((events.y, events.x), shape))
        channel = (y * PARTS + x) * 2 + events.p[:n_event]
        number = channel * n + ((events.t[:n_event] - begin) / self.bin_us).astype(np.int64)
        rate = np.bincount(number, minlength=2 * PARTS**2 * n).reshape(-1, n).astype(float)
        mean = rate.mean(axis=1, keepdims=True)
        rate -= mean
        power = (np.abs(np.fft.rfft(rate, 2 * n)) ** 2).sum(axis=0)
        correlation = np.fft.irfft(power)[: max(int(FARTHEST * n), 1)]
        correlation /= n - np.arange(len(correlation))
        correlation[0] -= n_event / n  # that events are counted at all
        whole = max(float(correlation[0]), 1e-12)
        self.alike = correlation / whole if n >= FEWEST_BINS else np.zeros(1)
        self._least = max(REPEATS, CLEAR * np.sqrt((mean**2).sum() / (n / 2)) / whole)

    def after(self, lag_us: float) -> float:
        """Give it for a time; not a number for one that is nearly nothing, or beyond `FARTHEST`."""
        k = round(lag_us / self.bin_us)
        near = self.alike[max(k - NEAR, 0) : k + NEAR + 1]
        return float(near.max()) if NEAR < k < len(self.alike) else np.nan

    def shortest(self) -> tuple[float, float]:
        """Give the shortest time [us] after which events come again, and how far they do at best; zeros if they never do."""
        below = np.flatnonzero(self.alike < 0)
        if not len(below):
            return 0.0, 0.0
        start = int(below[0])  # behind the first hump, which is that of no time at all
        rest = self.alike[start:]
        if rest.max() < self._least:
            return 0.0, 0.0
        k = start + int(np.argmax(rest >= ALIKE * rest.max()))
        while k + 1 < len(self.alike) and self.alike[k + 1] > self.alike[k]:
            k += 1
        return self._sharpened(k), float(rest.max())

    def _sharpened(self, k: int) -> float:
        """Give a time by its multiples."""
        period = float(k)
        for turns in range(2, 1 + int((len(self.alike) - 1 - NEAR) / period)):
            about = round(turns * period)
            near = np.arange(about - NEAR, about + NEAR + 1)
            period = near[np.argmax(self.alike[near])] / turns
        return period * self.bin_us
