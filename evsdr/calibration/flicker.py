"""The ring's own flicker: one LED that fades in and out over a constant light, and then stays dark for a while.

A pixel sees I = u(t) + v in units of the LED's light there: u, from 0 to 1, is the duty cycle of the carriers, known to one
part in 255; v, the constant light over the LED's, differs from pixel to pixel and is fitted: log I bends as v says, and
only at the true one do all changes of a pixel between two events, C_on on the way up and C_off down, agree. No waveform has to
be calibrated, and whatever the camera looks at will do. In the dark part only noise, leaks, hot pixels and the room fire.
"""

from dataclasses import dataclass

import numpy as np

from evsdr.errors import InputError
from evsdr.events.pairs import pair_events
from evsdr.events.phase import phase, position
from evsdr.records import Recording, Schedule

VEILS = np.geomspace(0.003, 3.0, 70)  # v that are tried
FEWEST = 20  # pairs of a pixel that tell its v
OUTLIER = 0.3  # of a pixel's median change, beyond which a pair says nothing of v
SETTLED = 0.3  # of a dark slot, after which it is dark
HOT_HZ = 10.0  # of events in the dark, from which a pixel is hot
# Of lamps in the room; times what chance makes of their share (Rayleigh 1880)
MAINS_HZ, CLEAR = (100.0, 120.0), 4.0


def is_flicker(schedule: Schedule) -> bool:
    """Tell whether a schedule has one LED, dark slots, and fades."""
    lit = np.unique(schedule.order[schedule.order >= 0])
    return len(lit) == 1 and (schedule.order < 0).any() and schedule.crossfade > 0


@dataclass(frozen=True)
class Flicker:
    """What the pairs of a flicker tell.

    Attributes
    ----------
    change : (n_pair,) float
        Of log I, at each pixel's own v.
    polarity : (n_pair,) int
    pixel : (n_pair,) int
        Row-major.
    veil : (n_pixel,) float
        v; NaN where too few pairs tell it.
    left_open : (n_pair,) float
        Standard deviation of the change as v is known no better.
    dark_hz : (n_pixel,) float
        Events in the dark.
    mains : dict of float to float
        Share of the dark events that come with a frequency [Hz] of lamps, 1 for all at one phase; of clear ones.
    """

    change: np.ndarray
    polarity: np.ndarray
    pixel: np.ndarray
    veil: np.ndarray
    left_open: np.ndarray
    dark_hz: np.ndarray
    mains: dict


def read_flicker(recording: Recording) -> Flicker:
    """Find each pixel's v, and what fires in the dark.

    Raises
    ------
    InputError
        No pixel's events tell its v.
    """
    schedule, n_pixel = recording.schedule, recording.sensor.height * recording.sensor.width
    pairs = pair_events(recording)
    pixel = np.repeat(np.arange(n_pixel), np.diff(pairs.offset.astype(np.int64)))
    start, end = (duty(of, schedule) for of in (pairs.phase_start, pairs.phase_end))
    polarity = pairs.polarity.astype(int)
    veil, sigma = _veils(start, end, polarity, pixel, n_pixel)
    if not np.isfinite(veil).any():
        raise InputError(
            "no pixel has enough events of the fading LED; record more rounds, with the constant light on and the "
            "LED on what the camera sees."
        )
    own = np.where(np.isfinite(veil), veil, np.nanmedian(veil))[pixel]
    dark_hz, mains = _in_the_dark(recording, n_pixel)
    left_open = np.abs(own / (end + own) - own / (start + own)) * sigma[pixel]
    change = np.log((end + own) / (start + own))
    return Flicker(change, polarity, pixel, veil, left_open, dark_hz, mains)


def duty(at: np.ndarray, schedule: Schedule) -> np.ndarray:
    """Give u at phases of the ring."""
    lit = np.append(schedule.order, schedule.order[0]) >= 0
    slot = np.floor(at).astype(int)
    fade = at - slot
    return (1 - fade) * lit[slot] + fade * lit[slot + 1]


def _veils(start, end, polarity, pixel, n_pixel) -> tuple[np.ndarray, np.ndarray]:
    """Give v of each pixel (n_pixel,), at which its changes scatter least around their means, and sigma of its logarithm.

    It is NaN where it is not told. Sigma is that of least squares, by the curvature at the minimum.
    """
    up = (polarity > 0).astype(int)
    group, right = 2 * pixel + up, (end - start) * polarity > 0
    group, start, end = group[right], start[right], end[right]
    number = np.bincount(group, minlength=2 * n_pixel)
    kept, costs = np.ones(len(group), bool), None
    for _ in range(2):  # first all pairs, then those near their mean at the v that was found
        costs = np.stack([_scatter(start, end, v, group, kept, n_pixel) for v in VEILS])
        best = np.clip(costs.argmin(axis=0), 1, len(VEILS) - 2)
        own = VEILS[best][group // 2]
        change = np.abs(np.log((end + own) / (start + own)))
        mean = np.bincount(group, kept * change, 2 * n_pixel) / np.maximum(
            np.bincount(group, kept, 2 * n_pixel), 1
        )
        kept = np.abs(change - mean[group]) < OUTLIER * mean[group]
    below, here, above = (np.take_along_axis(costs, (best + k)[None], 0)[0] for k in (-1, 0, 1))
    bend, step = np.maximum(below - 2 * here + above, 1e-30), np.log(VEILS[1] / VEILS[0])
    veil = VEILS[best] * np.exp(step * np.clip(0.5 * (below - above) / bend, -1, 1))
    told = (np.minimum(number[::2], number[1::2]) >= FEWEST) & (costs.argmin(axis=0) == best)
    n_kept = np.bincount(group // 2, kept, n_pixel)
    sigma = step * np.sqrt(2 * np.maximum(here, 0) / np.maximum(n_kept, 1) / bend)
    return np.where(told, veil, np.nan), np.minimum(np.where(told, sigma, 1.0), 1.0)


def _scatter(start, end, veil: float, group, kept, n_pixel: int) -> np.ndarray:
    """Give the relative variance of each pixel's changes, both polarities together."""
    change = np.abs(np.log((end + veil) / (start + veil)))[kept]
    group = group[kept]
    n, total, square = (np.bincount(group, w, 2 * n_pixel) for w in (np.ones(len(group)), change, change**2))
    mean = total / np.maximum(n, 1)
    relative = (square - n * mean**2) / np.maximum(mean, 1e-12) ** 2
    return relative[::2] + relative[1::2]


def _in_the_dark(recording: Recording, n_pixel: int) -> tuple[np.ndarray, dict]:
    """Count each pixel's events in the dark [Hz], and tell how many follow lamps in the room."""
    events, schedule = recording.events, recording.schedule
    at, inside = phase(events.t, schedule, recording.round_start_us)
    slot = np.minimum(at.astype(int), len(schedule.order) - 1)
    dark = (schedule.order < 0) & (np.roll(schedule.order, -1) < 0)
    fraction, _ = position(events.t, schedule, recording.round_start_us)
    some = inside & dark[slot] & (fraction % 1 > SETTLED)
    pixel = events.y.astype(np.int64) * recording.sensor.width + events.x
    rounds = np.ptp(events.t[inside]) / schedule.slot_us / len(schedule.order) if inside.any() else 1.0
    seconds = 1e-6 * (1 - SETTLED) * schedule.slot_us * dark.sum() * max(round(rounds), 1)
    hz = np.bincount(pixel[some], minlength=n_pixel) / max(seconds, 1e-9)
    t = events.t[some & (hz[pixel] < HOT_HZ)]
    share = {f: float(np.abs(np.exp(2e-6j * np.pi * f * t).sum())) for f in MAINS_HZ}
    return hz, {f: value / len(t) for f, value in share.items() if value > CLEAR * np.sqrt(max(len(t), 1))}
