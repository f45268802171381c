"""What a slow photoreceptor makes of the ring's light, and when the light was what it shows.

A photoreceptor shows v, which follows log I with a time constant that falls with the light:

    (tau / I) dv/dt = log I - v.

While I is a ramp of slope b, d = log I - v has a closed form in I: with k = 1 / (tau b),

    dd/dI = 1 / I - k I d,    d(I) = exp(-k I^2 / 2) (d_0 exp(k I_0^2 / 2) + INT_(I_0)^I exp(k s^2 / 2) / s ds),

whose integral is half of Ei where light grows, and half of -E1 where it falls. While I stays, d decays. At a hard
switch v stays and d gains the change of log I; as v then passes through all the light between, it shows that of a
crossfade, as if there were one.

Shot noise makes v cross a threshold early, and some of that noise is still there when the reference is memorised:
both lie beyond v in the direction of the event. Between events of one polarity that cancels; the next event of the other
polarity needs that much less twice.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from scipy import special

LOG_Z = np.linspace(-16.0, 8.0, 4097)  # of the tables; between their points they are interpolated
LARGEST_Z = np.exp(LOG_Z[-1])
FLAT = 1e-6  # change of I over a slot, relative to it, below which it stays
MOST_EARLY = (
    0.08  # of a crossfade, by noise: where light hardly changes the model's is too uncertain for more
)
ROUNDING = 1e-9  # of what is shown, relative
N_ROUND = 2  # until a pixel does not know how it was started


def _tables() -> np.ndarray:
    """Give exp(-z) Ei(z) and exp(z) E1(z) at exp(LOG_Z)."""
    z = np.exp(LOG_Z)
    small = np.minimum(z, 50.0)
    terms = [np.ones_like(z)]
    for n in range(1, 8):  # asymptotic series
        terms.append(terms[-1] * n / np.maximum(z, 50.0))
    series = np.array(terms) / np.maximum(z, 50.0)
    signs = (-1.0) ** np.arange(8)[:, None]
    rising = np.where(z < 50, np.exp(-small) * special.expi(small), series.sum(axis=0))
    falling = np.where(z < 50, np.exp(small) * special.exp1(small), (signs * series).sum(axis=0))
    return np.array([rising, falling])


TABLES = _tables()


@dataclass(frozen=True)
class Photoreceptors:
    """The photoreceptors of some pixels, while the ring goes round and round.

    Attributes
    ----------
    light : (n_pixel, n_slot) float64
        I of each pixel with each slot's LED fully lit.
    late : (n_pixel, n_slot) float64
        log I - v where these slots start.
    row_of : (height * width,) int32
        Rows of the image's pixels in these arrays; -1 for pixels whose light is unknown.
    tau_slots : float
        Time constant at I = 1, in slots.
    crossfade : float
        Fraction of a slot in which its LED fades into the next.
    noise : float
        Mean noise of log I in an event's direction when it fires, and when its light is memorised.
    """

    light: np.ndarray
    late: np.ndarray
    row_of: np.ndarray
    tau_slots: float
    crossfade: float
    noise: float = 0.0

    @classmethod
    def under(
        cls, light: np.ndarray, row_of: np.ndarray, tau_slots: float, crossfade: float, noise: float = 0.0
    ) -> "Photoreceptors":
        """Let the ring go round over photoreceptors; arguments as the attributes."""
        light = np.ascontiguousarray(light, np.float64)
        return cls(light, _late(light, tau_slots, crossfade, TABLES), row_of, tau_slots, crossfade, noise)

    def shown(
        self, position: np.ndarray, pixel: np.ndarray, polarity: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """Give the phase at which the light was what photoreceptors show.

        Parameters
        ----------
        position : (n,) float64
            Slot + the fraction of it that is over.
        pixel : (n,) int
            y * width + x.
        polarity : (n,) float, optional
            1 or -1 of the event whose noise is seen, too; 0 for none.

        Returns
        -------
        (n,) float32
            Phases; those of now for pixels whose light is unknown.
        """
        row = self.row_of[pixel]
        noise = np.broadcast_to(np.float64(self.noise) * polarity, len(row))
        return _shown(position, row, noise, self.light, self.late, self.tau_slots, self.crossfade, TABLES)


@njit(cache=True, inline="always")
def _read(table, z):
    """Interpolate a table; above it both functions are 1 / z, below it straight in log z."""
    if z > LARGEST_Z:
        return 1 / z
    at = (np.log(z) - LOG_Z[0]) / (LOG_Z[1] - LOG_Z[0])
    k = min(max(int(at), 0), len(LOG_Z) - 2)
    return table[k] + (at - k) * (table[k + 1] - table[k])


@njit(cache=True)
def _follow(late, start, end, duration, tau, tables):
    """Give log I - v at the end of a ramp, from that at its start; times in slots."""
    if duration == 0:
        return late + np.log(end / start)
    slope = (end - start) / duration
    if abs(end - start) <= FLAT * start:
        return late * np.exp(-0.5 * (start + end) * duration / tau)
    z0, z = start**2 / (2 * tau * abs(slope)), end**2 / (2 * tau * abs(slope))
    kept = np.exp(-abs(z - z0))
    if slope > 0:
        return late * kept + 0.5 * (_read(tables[0], z) - kept * _read(tables[0], z0))
    return late * kept + 0.5 * (kept * _read(tables[1], z0) - _read(tables[1], z))


@njit(cache=True, parallel=True)
def _late(light, tau, crossfade, tables):
    """Give log I - v at the starts of the slots."""
    n_pixel, n_slot = light.shape
    out = np.zeros((n_pixel, n_slot))
    for i in prange(n_pixel):
        late = 0.0
        for k in range(N_ROUND * n_slot):
            slot, following = k % n_slot, (k + 1) % n_slot
            out[i, slot] = late
            late = _follow(late, light[i, slot], light[i, slot], 1 - crossfade, tau, tables)
            late = _follow(late, light[i, slot], light[i, following], crossfade, tau, tables)
        out[i, 0] = late
    return out


@njit(cache=True, parallel=True)
def _shown(position, row, noise, light, late, tau, crossfade, tables):
    """See `Photoreceptors.shown`."""
    n_slot = light.shape[1]
    out = np.empty(len(position), np.float32)
    for k in prange(len(position)):
        slot = min(int(position[k]), n_slot - 1)
        past = position[k] - slot
        fade = max(past - (1 - crossfade), 0.0) / crossfade if crossfade > 0 else 0.0
        i = row[k]
        if i < 0:
            out[k] = slot + fade
            continue
        start = light[i, slot]
        behind = _follow(late[i, slot], start, start, min(past, 1 - crossfade), tau, tables)
        now = start + fade * (light[i, (slot + 1) % n_slot] - start)
        behind = _follow(behind, start, now, fade * crossfade, tau, tables)
        shown = now * np.exp(-behind)
        out[k] = slot + fade
        end, reached = now, fade
        for back in range(n_slot):
            at = (slot - back) % n_slot
            start = light[i, at]
            if min(start, end) <= shown * (1 + ROUNDING) and shown <= max(start, end) * (1 + ROUNDING):
                share = (shown - start) / (end - start) if end != start else 1.0
                fade = reached * share
                rise = (light[i, (at + 1) % n_slot] - start) / shown
                if rise != 0:
                    fade += min(max(noise[k] / rise, -MOST_EARLY), MOST_EARLY)
                out[k] = at + min(max(fade, 0.0), 1.0)
                break
            end, reached = start, 1.0
        if out[k] >= n_slot:
            out[k] = 0.0
    return out
