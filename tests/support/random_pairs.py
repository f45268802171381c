"""Random signals, slope derivatives and pairs, and what a plain loop makes of them."""

from dataclasses import dataclass

import mitsuba as mi
import numpy as np

from evsdr.solve.loss import derivative_table
from evsdr.solve.pair_data import PairData, bounds, pack_phases, pack_slots

N_LED, N_BAND, N_PIXEL, C_W, SCALE, ROBUST = 6, 3, 21, 0.1, 0.2, 3.0
ORDER = np.array([0, 1, -1, 2, 5, 4, 3, 3])
BAND = [j % N_BAND for j in range(N_LED)]
N = 2 + N_BAND + 2  # unknowns


@dataclass(frozen=True)
class Scene:
    """Signals (N_LED, N_PIXEL) with their slope derivatives, pairs and silences in NumPy, and all of it for the solver.

    A pixel's silences have the phases of its pairs, every third without an event, and three probes each.
    """

    signal: np.ndarray
    by_p: np.ndarray
    by_q: np.ndarray
    share: np.ndarray
    offset: np.ndarray
    start: np.ndarray
    end: np.ndarray
    polarity: np.ndarray
    ended: np.ndarray
    probe: np.ndarray
    on: np.ndarray
    off: np.ndarray
    weight: np.ndarray
    bias: np.ndarray
    silent_bias: np.ndarray
    pairs: PairData

    @classmethod
    def draw(cls, rng):
        """Draw one; some pixels have no pair."""
        signal = rng.uniform(0.05, 1, (N_LED, N_PIXEL)).astype(np.float32)
        by_p, by_q = rng.normal(0, 0.3, (2, N_LED, N_PIXEL)).astype(np.float32)
        share = rng.uniform(0.3, 1, signal.shape).astype(np.float32)
        count = rng.integers(0, 9, N_PIXEL)
        count[[0, 5]] = 0
        n = count.sum()
        start, end = rng.uniform(0, len(ORDER), (2, n)).astype(np.float32)
        end[3] = np.nextafter(np.float32(len(ORDER)), np.float32(0))  # 1 + end rounds up to 1 + n_slot
        start[7] = 2.0
        polarity = rng.choice([-1, 1], n)
        ended = np.where(np.arange(n) % 3, polarity, 0)
        probe = rng.integers(0, len(ORDER), (n, 3)).astype(np.float32)
        on, off = rng.uniform(0.1, 0.4, (2, N_PIXEL)).astype(np.float32)
        weight = rng.uniform(0, 2, n).astype(np.float32)
        bias, silent_bias = rng.normal(0, 0.05, (2, n)).astype(np.float32)
        offset = np.append(0, np.cumsum(count))
        first, last = bounds(offset, mi.UInt32)
        pairs = PairData(
            first=first,
            last=last,
            phases=mi.Float(pack_phases(start, end, polarity)),
            threshold_on=mi.Float(on),
            threshold_off=mi.Float(off),
            slot_leds=mi.UInt32(pack_slots(ORDER, N_LED)),
            silent_first=first,
            silent_last=last,
            silent_phases=mi.Float(pack_phases(start, end, ended)),
            silent_probes=mi.UInt32((3 * np.arange(n)[:, None] + [0, 3]).astype(np.uint32).ravel()),
            silent_bias=mi.Float(silent_bias),
            probes=mi.Float(probe.ravel()),
            bias=mi.Float(bias),
        )
        given = signal, by_p, by_q, share, offset, start, end, polarity, ended, probe, on, off, weight
        return cls(*given, bias, silent_bias, pairs)

    def table(self, diffuse=None):
        """Give the solver's table; `diffuse` (N_LED, N_PIXEL) is the part that scales with the reflectance."""
        rows = [[mi.Float(row) for row in part] for part in (self.signal, self.by_p, self.by_q)]
        return derivative_table(
            *rows, BAND, N_PIXEL, diffuse if diffuse is None else [mi.Float(d) for d in diffuse]
        )

    def light(self, i, phase, theta, share=1.0):
        """Give I of pixel i at a phase when its unknowns change by theta, and the signals of its LEDs."""
        share = np.broadcast_to(share, self.signal.shape)[:, i]
        lit = self.signal[:, i] + self.by_p[:, i] * theta[0] + self.by_q[:, i] * theta[1]
        lit = lit * (1 + share * np.expm1(theta[2 : 2 + N_BAND][BAND]))
        return mixture(float(phase)) @ lit + C_W, np.append(lit, 0)  # LED -1 is darkness

    def threshold(self, i, polarity, theta):
        """Give its threshold."""
        return (self.on if polarity > 0 else self.off)[i] * np.exp(theta[2 + N_BAND + (polarity < 0)])

    def change(self, i, start, end, theta, share=1.0):
        """Give the change of log I between two phases."""
        return np.log(self.light(i, end, theta, share)[0] / self.light(i, start, theta, share)[0])


def mixture(phase):
    """Shares of the LEDs (N_LED) lit at a phase."""
    slot, share = int(phase) % len(ORDER), np.zeros(N_LED)
    fade = phase - int(phase)
    for led, part in ((ORDER[slot], 1 - fade), (ORDER[(slot + 1) % len(ORDER)], fade)):
        if led >= 0:
            share[led] += part
    return share


def derivative(function, n=N):
    """Give the derivatives of a function of changes by finite differences."""
    return np.array([(function(h) - function(-h)) / 2e-5 for h in 1e-5 * np.eye(n)])
