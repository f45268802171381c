"""Loops over events: sort them by pixel, pair them, list silences. `pairs` says what these are."""

import numpy as np
from numba import njit

ROUNDING_US = 1.0  # times are whole microseconds


@njit(cache=True)
def sort_by_pixel(x, y, p, t, mask):
    """Sort events by pixel, row after row; time order stays within a pixel.

    Parameters
    ----------
    x, y, p, t : (n_event,) int
        Events in time order.
    mask : (height, width) bool
        Pixels whose events are kept.

    Returns
    -------
    offset : (n_pixel + 1,) int64
        Events of pixel i = y * width + x are offset[i] .. offset[i+1].
    p_sorted, t_sorted : (n_kept,) int8, int64
    """
    height, width = mask.shape
    offset = np.zeros(height * width + 1, np.int64)
    for k in range(len(t)):
        if mask[y[k], x[k]]:
            offset[np.int64(y[k]) * width + x[k] + 1] += 1
    offset = np.cumsum(offset)
    place = offset[:-1].copy()
    p_sorted, t_sorted = np.empty(offset[-1], np.int8), np.empty(offset[-1], np.int64)
    for k in range(len(t)):
        if mask[y[k], x[k]]:
            pixel = np.int64(y[k]) * width + x[k]
            p_sorted[place[pixel]], t_sorted[place[pixel]] = p[k], t[k]
            place[pixel] += 1
    return offset, p_sorted, t_sorted


@njit(cache=True)
def pair(offset, p, t, fired, fired_inside, memorised, memorised_inside, refractory_us, ahead, left, answer):
    """Pair each event with the one before it in its pixel.

    Parameters
    ----------
    offset, p, t
        See `sort_by_pixel`.
    fired, memorised : (n_event,) float32
        Phase of each event, and one refractory period later.
    fired_inside, memorised_inside : (n_event,) bool
        Whether these lie within the rounds.
    refractory_us : float
    ahead, left : (n_event,) float32
        What is added to log I when each event fires, and when its light is memorised.
    answer : (2, n_event) float32
        By how much log I counts then; or (2, 0): by 1.

    Returns
    -------
    pair_offset : (n_pixel + 1,) uint32
    start, end, polarity, bias : (n_pair,) float32, float32, int8, float32
    answers : (n_pair, 2) float32, or (0, 2)
        At start and end.
    n_dropped, n_close : int
        Pairs left out, and those of them that are too close.
    """
    pair_offset = np.zeros(len(offset), np.uint32)
    start, end = np.empty(len(t), np.float32), np.empty(len(t), np.float32)
    polarity, bias = np.empty(len(t), np.int8), np.empty(len(t), np.float32)
    answers = np.empty((answer.shape[1], 2), np.float32)
    n, n_dropped, n_close = 0, 0, 0
    for pixel in range(len(offset) - 1):
        for k in range(offset[pixel] + 1, offset[pixel + 1]):
            early = t[k] - t[k - 1] - refractory_us  # how long after the reference was memorised
            too_close = early < -ROUNDING_US
            n_close += too_close
            if too_close or not fired_inside[k] or (early >= 0 and not memorised_inside[k - 1]):
                n_dropped += 1
                continue
            start[n] = fired[k] if early < 0 else memorised[k - 1]
            end[n], polarity[n] = fired[k], 2 * p[k] - 1
            bias[n] = ahead[k] - (ahead[k] if early < 0 else left[k - 1])
            if answer.shape[1]:
                answers[n, 0] = answer[0, k] if early < 0 else answer[1, k - 1]
                answers[n, 1] = answer[0, k]
            n += 1
        pair_offset[pixel + 1] = n
    lists = start[:n].copy(), end[:n].copy(), polarity[:n].copy(), bias[:n].copy(), answers[:n].copy()
    return pair_offset, *lists, n_dropped, n_close


@njit(cache=True)
def list_silences(
    offset, p, t, fired, fired_inside, memorised, memorised_inside, told, refractory_us, slot_us, n_slot, last
):
    """List the silences in which slots start, each between an event and the next of its pixel or the end.

    Parameters
    ----------
    offset ... memorised_inside, refractory_us
        See `pair`.
    told : (n_event,) float32, (n_event,) float32, (n_event,) float32
        Phases of the light that is shown at each event, and memorised after it, if others than `fired` and `memorised`;
        what noise adds to log I when it is memorised.
    slot_us : float
    n_slot : int
    last : (float, float, bool)
        Time of the end [us], its phase, and whether it lies within the rounds.

    Returns
    -------
    silent_offset : (n_pixel + 1,) uint32
    start, end, polarity, bias : (n_silence,) float32, float32, int8, float32
        Polarity 0 where no event ends the silence.
    probe_offset : (n_silence + 1,) uint32
    probe : (n_probe,) float32
        Slots that start.
    """
    last_us, last_phase, last_inside = last
    shown, kept, left = told
    crossed = np.zeros(len(t), np.int32)
    silent_offset = np.zeros(len(offset), np.uint32)
    n, n_probe = 0, 0
    for pixel in range(len(offset) - 1):
        for k in range(offset[pixel], offset[pixel + 1]):
            followed = k + 1 < offset[pixel + 1]
            length = (t[k + 1] if followed else last_us) - t[k] - refractory_us
            inside = fired_inside[k + 1] if followed else last_inside
            if memorised_inside[k] and inside and length > 0:
                slot = np.int64(fired[k + 1] if followed else last_phase)
                passed = (slot - np.int64(memorised[k])) % n_slot
                rounds = np.rint((length / slot_us - passed) / n_slot)
                crossed[k] = min(passed + n_slot * max(rounds, 0.0), n_slot)
                n += crossed[k] > 0
                n_probe += crossed[k]
        silent_offset[pixel + 1] = n
    start, end, polarity = np.empty(n, np.float32), np.empty(n, np.float32), np.zeros(n, np.int8)
    bias = np.empty(n, np.float32)
    probe_offset, probe = np.zeros(n + 1, np.uint32), np.empty(n_probe, np.float32)
    n, n_probe = 0, 0
    for pixel in range(len(offset) - 1):
        for k in range(offset[pixel], offset[pixel + 1]):
            if crossed[k] == 0:
                continue
            start[n], end[n], bias[n] = kept[k], last_phase, -left[k]
            if k + 1 < offset[pixel + 1]:
                end[n], polarity[n] = shown[k + 1], 2 * p[k + 1] - 1
            for step in range(1, crossed[k] + 1):
                probe[n_probe] = (np.int64(memorised[k]) + step) % n_slot
                n_probe += 1
            n += 1
            probe_offset[n] = n_probe
    return silent_offset, start, end, polarity, bias, probe_offset, probe
