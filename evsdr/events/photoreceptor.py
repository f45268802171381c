"""Pixels whose photoreceptors lag and are noisy: what light they show when events fire, and when it is memorised."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from evsdr.events.lead import TABLE, kept, lead_of
from evsdr.events.receptor import N_COLUMN, follow, late_at, light_at, own_rate, shown_at
from evsdr.threads import N_CHUNK, in_chunks

SHORTEST = 1e-6  # time constant: faster ones show the light of now
MORE = 1e-3  # of log light, for derivatives
# Bounds of an answer: a receptor that falls into the dark may show less for more light, which no slope of log I can say. Guessed
LEAST_ANSWER, MOST_ANSWER = 0.25, 4.0


@dataclass(frozen=True)
class Shown:
    """What photoreceptors show of each event.

    Attributes
    ----------
    fired, memorised : (n_event,) float32
        Phases at which the light was what is shown when the event fires, and when its light is memorised.
    ahead, left : (n_event,) float32
        What noise adds to log I then.
    answer : (2, n_event) float32
        By how much what is shown rises with the logarithm of all light, when the event fires and when its light is memorised:
        more light is also followed faster. 1 without a lag.
    log : (2, n_event) float32
        What is shown then, without noise.
    """

    fired: np.ndarray
    memorised: np.ndarray
    ahead: np.ndarray
    left: np.ndarray
    answer: np.ndarray
    log: np.ndarray


@dataclass(frozen=True)
class Photoreceptors:
    """The photoreceptors of some pixels, while the ring goes round and round; times in slots.

    Attributes
    ----------
    light : (n_pixel, n_slot) float64
        I of each pixel with each slot's LED fully lit.
    row_of : (height * width,) int32
        Rows of the image's pixels in `light`; -1 for pixels whose light is unknown: they show that of now.
    crossfade : float
        Fraction of a slot in which its LED fades into the next.
    tau, dark, noise, refractory : float
        See `solve.shared.rig.Rig`.
    """

    light: np.ndarray
    row_of: np.ndarray
    crossfade: float
    tau: float
    dark: float = 0.0
    noise: float = 0.0
    refractory: float = 0.0

    def shown(self, offset: np.ndarray, position: np.ndarray, polarity: np.ndarray) -> Shown:
        """Look at events.

        Parameters
        ----------
        offset : (height * width + 1,) int
            Events of each pixel.
        position : (n_event,) float64
            Slot + the fraction of it that is over when the event fires.
        polarity : (n_event,) float
            1 or -1.
        """
        out = np.empty((8, len(position)), np.float32)
        given = *self._values, np.asarray(offset, np.int64), position, polarity
        in_chunks(lambda chunk: _shown(chunk, *given, self.noise, self.refractory, TABLE, out))
        return Shown(*out[:4], out[4:6], out[6:])

    def phases(self, offset: np.ndarray, slot: np.ndarray) -> np.ndarray:
        """Give the phases (n,) float32 at which the light was what is shown where slots (n,) of pixels start."""
        out, slot = np.empty(len(slot), np.float32), np.asarray(slot, np.float32)
        given = *self._values, np.asarray(offset, np.int64), slot
        in_chunks(lambda chunk: _shown_at_starts(chunk, *given, out))
        return out

    @property
    def _values(self) -> tuple:
        light = np.ascontiguousarray(self.light, np.float64)
        return light, self.row_of, self.crossfade, max(self.tau, SHORTEST), self.dark


@njit(cache=True, nogil=True, error_model="numpy")
def _shown(
    chunk, light, row_of, crossfade, tau, dark, offset, position, polarity, noise, refractory, lead, out
):
    """See `Photoreceptors.shown`; writes fired, memorised, ahead, left, the two answers and the two logarithms."""
    n_pixel, n_slot = len(offset) - 1, light.shape[1]
    nodes, nodes_more = np.zeros((n_slot, N_COLUMN)), np.zeros((n_slot, N_COLUMN))
    nowhere = np.ones(n_slot)
    each = (n_pixel + N_CHUNK - 1) // N_CHUNK
    for pixel in range(chunk * each, min((chunk + 1) * each, n_pixel)):
        if offset[pixel] == offset[pixel + 1]:
            continue
        row = row_of[pixel]
        here = light[row] if row >= 0 else nowhere
        more = here * np.exp(MORE)
        if row >= 0:
            follow(here, tau, dark, crossfade, nodes)
            follow(more, tau, dark, crossfade, nodes_more)
        for k in range(offset[pixel], offset[pixel + 1]):
            ahead, level, velocity = 0.0, 0.0, 0.0
            for end in range(2):
                at = (position[k] + end * refractory) % n_slot
                late = late_at(at, here, tau, dark, crossfade, nodes) if row >= 0 else 0.0
                slot, fade = shown_at(at, late, here, crossfade)
                phase = np.float32(slot + fade)
                out[end, k] = phase if phase < n_slot else 0.0
                late_more = late_at(at, more, tau, dark, crossfade, nodes_more) if row >= 0 else 0.0
                out[4 + end, k] = min(max(1 - (late_more - late) / MORE, LEAST_ANSWER), MOST_ANSWER)
                out[6 + end, k] = np.log(light_at(at, here, crossfade)) - late
                if noise == 0 or row < 0:
                    out[2 + end, k] = 0.0
                    continue
                own = own_rate(at, here, tau, dark, crossfade)
                if end == 0:
                    ahead, _, velocity = lead_of(lead, noise, late, own, at, nodes, crossfade, 0.0)
                    out[2, k] = polarity[k] * noise * ahead
                else:
                    level, share = kept(refractory * own, 0.0)
                    out[3, k] = polarity[k] * noise * (level * ahead + share * velocity)


@njit(cache=True, nogil=True, error_model="numpy")
def _shown_at_starts(chunk, light, row_of, crossfade, tau, dark, offset, slot, out):
    """See `Photoreceptors.phases`; a pixel shows the same at each start of a slot."""
    n_pixel, n_slot = len(offset) - 1, light.shape[1]
    nodes, shown = np.zeros((n_slot, N_COLUMN)), np.empty(n_slot, np.float32)
    each = (n_pixel + N_CHUNK - 1) // N_CHUNK
    for pixel in range(chunk * each, min((chunk + 1) * each, n_pixel)):
        if offset[pixel] == offset[pixel + 1]:
            continue
        row = row_of[pixel]
        if row >= 0:
            follow(light[row], tau, dark, crossfade, nodes)
        for k in range(n_slot):
            shown[k] = k
            if row >= 0:
                late = late_at(float(k), light[row], tau, dark, crossfade, nodes)
                start, fade = shown_at(float(k), late, light[row], crossfade)
                phase = np.float32(start + fade)
                shown[k] = phase if phase < n_slot else 0.0
        for k in range(offset[pixel], offset[pixel + 1]):
            out[k] = shown[int(slot[k])]
