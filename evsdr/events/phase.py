"""How the light of the ring runs over time.

The phase is slot + fade: `slot` (0 .. n_slot - 1) counts along the order of the LEDs, `fade` (0 .. 1, 1 left
out) is the crossfade reached. At that phase a pixel sees

    I = (1 - fade) A[order[slot]] + fade A[order[slot + 1]] + C_w,

where the order starts over after its last slot and LED -1 is dark (A = 0).
"""

import warnings

import numpy as np

from evsdr.errors import InputWarning
from evsdr.records import Schedule

ROUND_TOLERANCE = 0.02  # of the time between two triggers, to count as whole rounds


def phase(t_us: np.ndarray, schedule: Schedule, round_start_us: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give the phase of the ring at any times.

    Between two round-start triggers the ring runs evenly through a whole number of rounds, so a drifting
    clock is followed. With one trigger it runs on from there by `slot_us`; with none, from
    `schedule.start_us`.

    Parameters
    ----------
    t_us : (...) int or float
        Times [us], in any order.
    schedule : Schedule
        Order, slot and crossfade.
    round_start_us : (n,) int
        Times of the round-start triggers [us], growing.

    Returns
    -------
    phase : (...) float64
        0 .. n_slot, n_slot left out.
    inside : (...) bool
        False before the first trigger (or the start) and after the last of several triggers, where the
        phase means nothing.

    Warns
    -----
    InputWarning
        Some triggers are not whole rounds apart; from those the ring runs on by `slot_us`.
    """
    at, inside = position(t_us, schedule, round_start_us)
    slot = np.floor(at)
    at -= slot
    at = _fade(at, schedule.crossfade)
    at += slot
    return np.where(at < len(schedule.order), at, 0.0), inside  # else by rounding, just before the start


def position(
    t_us: np.ndarray, schedule: Schedule, round_start_us: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Give the slot of the ring at any times, plus the fraction of it that is over; else as `phase`."""
    t, n_slot = np.asarray(t_us), len(schedule.order)
    if len(round_start_us) > 1:
        start, duration, slots = _intervals(schedule, np.asarray(round_start_us))
        inside = (t >= start[0]) & (t <= start[-1])
        interval = np.clip(np.searchsorted(start, t, side="right") - 1, 0, len(start) - 2)
        at = (t - start[interval]) * slots[interval]
        at /= duration[interval]
    else:
        start = round_start_us[0] if len(round_start_us) else schedule.start_us
        inside = t >= start
        at = (t - start) / schedule.slot_us
    return at % n_slot, inside


def _fade(fraction: np.ndarray, crossfade: float) -> np.ndarray:
    """Give the crossfade reached at a fraction of a slot."""
    if crossfade == 0:
        return np.zeros_like(fraction)
    return np.clip((fraction - (1 - crossfade)) / crossfade, 0, 1)


def _intervals(schedule: Schedule, start: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give the triggers, and per interval a duration [us] with the number of slots that run through in it."""
    round_us = schedule.slot_us * len(schedule.order)
    duration = np.diff(start).astype(np.float64)
    n_round = np.round(duration / round_us)
    fits = np.abs(duration - n_round * round_us) <= ROUND_TOLERANCE * n_round * round_us
    if not fits.all():
        warnings.warn(
            InputWarning(
                f"{np.sum(~fits)} of {len(fits)} intervals between round-start triggers are not whole rounds "
                f"of {round_us:g} us, so slot_us counts there; check slot_us, order and the triggers."
            ),
            stacklevel=4,
        )
    slots = np.where(fits, n_round * len(schedule.order), 1.0)
    return start, np.where(fits, duration, schedule.slot_us), slots


def weights(t_us: np.ndarray, schedule: Schedule, n_led: int, round_start_us: np.ndarray) -> np.ndarray:
    """Give the weights w_j(t) of the LEDs.

    Parameters
    ----------
    t_us : (n_time,) int or float
        Times [us].
    schedule : Schedule
        Order, slot and crossfade.
    n_led : int
        Number of LEDs.
    round_start_us : (n,) int
        Times of the round-start triggers [us].

    Returns
    -------
    (n_time, n_led) float64
        0 .. 1; all 0 at times that are not inside.
    """
    at, inside = phase(t_us, schedule, round_start_us)
    slot = at.astype(np.int64)
    fade = at - slot
    order = np.append(schedule.order, schedule.order[0])
    weight = np.zeros((len(at), n_led + 1))  # the last column, -1, is darkness
    row = np.arange(len(at))
    weight[row, order[slot]] += (1 - fade) * inside
    weight[row, order[slot + 1]] += fade * inside
    return weight[:, :n_led]
