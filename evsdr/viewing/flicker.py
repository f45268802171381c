"""Light that is not the ring's: events against the grain of a slot, and how often a second they come.

While one LED fades into the next, the light of a pixel only rises or only falls. Two successive events of a pixel in one
slot that differ in polarity are of other light, or of noise; if they keep time, it is a lamp on the mains.
"""

from dataclasses import dataclass

import numpy as np

from evsdr.records import Schedule
from evsdr.viewing.sample import Sample, slots_of

SETTLED = 0.2  # of a slot, from which on pixels have forgotten the one before; measured: with 0.1 an EVK4's lag shows
BIN_US = 500  # of time
SHORTEST = 4096  # bins that are transformed: frequencies are then half a Hz apart, or nearer
RANGE_HZ = 15.0, 400.0  # that is looked at
MAINS_HZ = 100.0, 120.0  # a lamp's light goes with the square of the mains
NEAR_HZ = 1.5  # by which the mains may be off
# Of the beat, from which events keep time; measured: 0.8 and more for a lamp, noise less than 0.2
IN_TIME = 0.4
FEWEST = 20  # events against the grain that tell anything


@dataclass(frozen=True)
class Flicker:
    """Events against the grain.

    Attributes
    ----------
    share : float
        Of the pairs of successive events of a pixel in one slot.
    n : int
        How many.
    hz : (n_hz,) float
        Frequencies.
    beat : (n_hz,) float
        How far they keep time with each, 0..1.
    """

    share: float
    n: int
    hz: np.ndarray
    beat: np.ndarray

    @property
    def mains_hz(self) -> float:
        """Give 100 or 120 where events against the grain keep time with that; else 0."""
        heard = {hz: self.beat[np.abs(self.hz - hz) < NEAR_HZ].max() for hz in MAINS_HZ}
        hz = max(heard, key=heard.get)
        return hz if self.n >= FEWEST and heard[hz] > IN_TIME else 0.0


def find_flicker(sample: Sample, schedule: Schedule, starts: np.ndarray) -> Flicker:
    """Look for other light."""
    slot, over, inside = slots_of(sample, schedule, starts)
    pairs = sample.together & inside[1:] & inside[:-1] & (over[:-1] > SETTLED)
    pairs &= (slot[1:] == slot[:-1]) & (np.diff(sample.t) < schedule.slot_us)
    against = pairs & (sample.p[1:] != sample.p[:-1])
    n = int(np.count_nonzero(against))
    which = 1 + np.flatnonzero(against)
    hz, beat = spectrum(sample.t[which], sample.p[which], sample.t)
    return Flicker(n / max(np.count_nonzero(pairs), 1), n, hz, beat)


def spectrum(t: np.ndarray, p: np.ndarray, within: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give frequencies [Hz], and how far signed events keep time with each, 0..1, within the span of times [us]."""
    begin, end = within.min(), within.max()
    n_bin = max(int((end - begin) / BIN_US) + 1, 8)
    size = max(SHORTEST, 1 << int(np.ceil(np.log2(2 * n_bin))))
    signal = np.bincount((t - begin) // BIN_US, p, n_bin)[:n_bin]
    hz = np.fft.rfftfreq(size, 1e-6 * BIN_US)
    beat = np.abs(np.fft.rfft(signal, size)) / max(len(t), 1)
    kept = (hz > RANGE_HZ[0]) & (hz < RANGE_HZ[1])
    return hz[kept], beat[kept]
