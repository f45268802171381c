"""Pairs of consecutive events of a pixel, the measurements that the solver explains."""

import warnings
from dataclasses import dataclass

import numpy as np

from evsdr.errors import InputError, InputWarning
from evsdr.records import Recording
from evsdr.ring_light import phase

ROUNDING_US = 1.0  # times are whole microseconds
TOO_CLOSE_SHARE = 0.05  # of pairs within the refractory period, before a warning
CHUNK = 1 << 17  # times whose phases are computed together: they stay in the cache


@dataclass(frozen=True)
class Pairs:
    """Event pairs, pixel after pixel (row after row) and in time order within each.

    Attributes
    ----------
    offset : (n_pixel + 1,) uint32
        Pairs of pixel i = y * width + x are offset[i] .. offset[i+1].
    phase_start, phase_end : (n_pair,) float32
        Phase of the ring (slot + crossfade fraction), 0 <= phase < n_slot, when the reference intensity is
        memorised and when the event fires.
    polarity : (n_pair,) int8
        +1 (brighter) or -1 of the event that ends the pair.
    n_event : int
        Events looked at.
    n_dropped : int
        Pairs left out: not within the rounds, or closer than the refractory period.
    silent_offset : (n_pixel + 1,) uint32
        Silent probes of pixel i are silent_offset[i] .. silent_offset[i+1].
    silent_start, silent_probe : (n_probe,) float32
        Phase at which the reference was memorised, and the start of a later slot until which no event has
        fired. A silence longer than a round is probed for one round.
    """

    offset: np.ndarray
    phase_start: np.ndarray
    phase_end: np.ndarray
    polarity: np.ndarray
    n_event: int
    n_dropped: int
    silent_offset: np.ndarray
    silent_start: np.ndarray
    silent_probe: np.ndarray


def pair_events(recording: Recording, mask: np.ndarray | None = None) -> Pairs:
    """Pair each event with the one before it in its pixel.

    Two events at t_(k-1) and t_k say log I(t_k) - log I(t_(k-1) + refractory) = p_k C, so a pair starts at
    t_(k-1) + refractory and ends at t_k.

    Parameters
    ----------
    recording : Recording
        Events in time order.
    mask : (H, W) bool, optional
        Pixels whose events count; all by default.

    Raises
    ------
    InputError
        No pair remains.

    Warns
    -----
    InputWarning
        Many events follow another within the refractory period.
    """
    events, sensor = recording.events, recording.sensor
    x, y, p, t = events.x, events.y, events.p, events.t
    if mask is not None:
        keep = mask[y, x]
        x, y, p, t = x[keep], y[keep], p[keep], t[keep]
    order = np.lexsort((x, y))  # stable, so time order stays within a pixel; 16-bit keys make it a radix sort
    pixel = (y.astype(np.uint32) * np.uint32(sensor.width) + x)[order]
    t, p = t[order], p[order]
    fired, fired_inside = _single_phase(t, recording)
    memorised, memorised_inside = _single_phase(t + sensor.refractory_us, recording)

    second = np.flatnonzero(pixel[1:] == pixel[:-1]) + 1
    early = t[second] - t[second - 1] - sensor.refractory_us  # how long after the reference was memorised
    too_close = early < -ROUNDING_US
    phase_start = np.where(early < 0, fired[second], memorised[second - 1])
    good = fired_inside[second] & (memorised_inside[second - 1] | (early < 0)) & ~too_close
    phase_start, second = phase_start[good], second[good]
    if not len(second):
        raise InputError(
            "No two events of a pixel follow each other within the rounds of the ring; "
            "check the triggers or start_us, refractory_us, and the mask."
        )
    if too_close.mean() > TOO_CLOSE_SHARE:
        warnings.warn(
            InputWarning(
                f"{too_close.mean():.0%} of the event pairs lie within refractory_us of the sensor, "
                f"{sensor.refractory_us:g} us; it is probably too long."
            ),
            stacklevel=2,
        )
    n_pixel = sensor.height * sensor.width
    count = np.bincount(pixel[second], minlength=n_pixel)
    silent = _silence(recording, pixel, t, fired, memorised, fired_inside, memorised_inside)
    return Pairs(
        offset=np.concatenate([[0], np.cumsum(count)]).astype(np.uint32),
        phase_start=phase_start,
        phase_end=fired[second],
        polarity=(2 * p[second] - 1).astype(np.int8),
        n_event=len(t),
        n_dropped=len(good) - len(second),
        silent_offset=silent[0],
        silent_start=silent[1],
        silent_probe=silent[2],
    )


def _silence(
    recording: Recording,
    pixel: np.ndarray,
    t: np.ndarray,
    fired: np.ndarray,
    memorised: np.ndarray,
    fired_inside: np.ndarray,
    memorised_inside: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """List the slot starts between each event and the next of its pixel, or the end of the recording.

    Parameters
    ----------
    pixel, t : (n_event,) int
        Events sorted by pixel, then time.
    fired, memorised : (n_event,) float32
        Phase of each, and one refractory period later.
    fired_inside, memorised_inside : (n_event,) bool
        Whether these lie within the rounds.
    """
    schedule, starts = recording.schedule, recording.round_start_us
    n_slot, sensor = len(schedule.order), recording.sensor
    last = np.array([starts[-1] - 1e-3 if len(starts) > 1 else t.max()])
    phase_last, last_inside = _single_phase(last, recording)
    followed = np.append(pixel[1:] == pixel[:-1], False)
    length = np.where(followed, np.append(t[1:], 0), last) - t - sensor.refractory_us
    phase_end = np.where(followed, np.append(fired[1:], 0), phase_last)
    end_inside = np.where(followed, np.append(fired_inside[1:], False), last_inside)
    first = memorised.astype(np.int32)
    crossed = (phase_end.astype(np.int32) - first) % n_slot
    rounds = np.rint((length / schedule.slot_us - crossed) / n_slot)
    crossed = np.minimum(crossed + n_slot * np.maximum(rounds, 0).astype(np.int32), n_slot)
    crossed[~(memorised_inside & end_inside & (length > 0))] = 0
    which = np.repeat(np.arange(len(t)), crossed)
    step = np.arange(len(which)) - np.repeat(np.cumsum(crossed) - crossed, crossed) + 1
    count = np.bincount(pixel, weights=crossed, minlength=sensor.height * sensor.width)
    return (
        np.concatenate([[0], np.cumsum(count)]).astype(np.uint32),
        memorised[which],
        ((first[which] + step) % n_slot).astype(np.float32),
    )


def _single_phase(t_us: np.ndarray, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Give phases in float32; what rounds up to n_slot becomes 0, where the light is the same."""
    single, inside = np.empty(len(t_us), np.float32), np.empty(len(t_us), bool)
    for k in range(0, len(t_us), CHUNK):
        part = slice(k, k + CHUNK)
        single[part], inside[part] = phase(t_us[part], recording.schedule, recording.round_start_us)
    single[single >= len(recording.schedule.order)] = 0
    return single, inside
