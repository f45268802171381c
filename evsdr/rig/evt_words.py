"""Decode the words of Prophesee's event streams: EVT 2.0 (32 bits), EVT 2.1 (64 bits), EVT 3.0 (16 bits).

Each word has its type in the four highest bits. Layouts:

    EVT 2.0   CD         polarity in the type (0, 1) | time 6 | x 11 | y 11
              time high  8 | bits 6..33 of the time
              trigger    A | time 6 | - 9 | id 5 | - 7 | value 1
    EVT 2.1   the same words in the upper half; the lower half of a CD word masks 32 pixels x, x + 1 ...
    EVT 3.0   y 0, x 2 (with polarity: an event), base x 3, masks of 12 (4) and of 8 (5) pixels from there
              on, time low 6 and high 8 (12 bits each), trigger A

Words before the first time high have no time and are left out. A time high that falls by more than half its
range has run over. Reference: docs.prophesee.ai, "Data Encoding Formats"; the vendor's decoder (OpenEB) takes
the time low as 0 from a new time high to the next time low, and so does this.

Words come block by block: `state` holds what one leaves to the next, `count` goes on.
"""

import numpy as np
from numba import njit

# Indices of the counts that the decoders give back
N_EVENT, N_TRIGGER, N_OUTSIDE, N_UNKNOWN, N_COUNT = range(5)

CD_OFF, CD_ON, TIME_HIGH, TRIGGER, IMU, OTHERS, CONTINUED = 0x0, 0x1, 0x8, 0xA, 0xD, 0xE, 0xF
ADDRESS_Y, ADDRESS_X, BASE_X, MASK_12, MASK_8, TIME_LOW, CONTINUED_4 = 0x0, 0x2, 0x3, 0x4, 0x5, 0x6, 0x7


def fresh() -> tuple[np.ndarray, np.ndarray]:
    """Give `state` and `count` before the first word."""
    # time high, time low, whether there is a time, row, column of the next mask, its polarity
    return np.array([0, 0, 0, -1, -1, 0]), np.zeros(N_COUNT, np.int64)


@njit(cache=True, inline="always")
def advance(high, new_high, period):
    """Give the new time high with the overflows before it; `period` is its range."""
    told = high % period
    return high - told + new_high + (period if told - new_high > period // 2 else 0)


@njit(cache=True, inline="always")
def _bits(mask):
    """Count the bits of 32 (Warren, Hacker's Delight, 5-1)."""
    mask = mask - ((mask >> np.uint32(1)) & np.uint32(0x55555555))
    mask = (mask & np.uint32(0x33333333)) + ((mask >> np.uint32(2)) & np.uint32(0x33333333))
    mask = (mask + (mask >> np.uint32(4))) & np.uint32(0x0F0F0F0F)
    mask = mask + (mask >> np.uint32(8))
    return (mask + (mask >> np.uint32(16))) & np.uint32(0x3F)


@njit(cache=True)
def room_evt2(words, has_mask):
    """Count the events and triggers that words may hold: as many as `decode_evt2` gives, or more."""
    n_event, n_trigger = np.int64(0), np.int64(0)
    for word in words:
        kind = np.uint64(word) >> np.uint64(60 if has_mask else 28)
        if kind <= CD_ON:
            n_event += np.int64(_bits(np.uint32(word & 0xFFFFFFFF))) if has_mask else 1
        n_trigger += kind == TRIGGER
    return n_event, n_trigger


@njit(cache=True)
def room_evt3(words):
    """Count the events and triggers that words may hold: as many as `decode_evt3` gives, or more."""
    n_event, n_trigger = np.int64(0), np.int64(0)
    for word in words:
        kind = word >> 12
        most = np.uint32(word) & np.uint32(0xFFF if kind == MASK_12 else 0xFF if kind == MASK_8 else 0)
        n_event += np.int64(kind == ADDRESS_X) + np.int64(_bits(most))
        n_trigger += kind == TRIGGER
    return n_event, n_trigger


@njit(cache=True)
def decode_evt2(words, width, height, x, y, p, t, trigger_p, trigger_t, trigger_id, state, count, has_mask):
    """Decode EVT 2.0, or EVT 2.1 with `has_mask`.

    Parameters
    ----------
    words : (n_word,) uint32 or uint64
        In the machine's byte order.
    width, height : int
        Of the sensor [pixels]; events outside are counted, not written.
    x, y, p, t : (n_event,) uint16, uint16, int8, int64
        Written: events, t in us, from `count` on, as far as there is room: the words may have changed since that was counted.
    trigger_p, trigger_t, trigger_id : (n_trigger,) int8, int64, int16
        Written: edges of the trigger inputs, p = 1 rises.

    state, count : (6,) and (N_COUNT,) int64
        See `fresh`; changed. Counts are the numbers of events, triggers, events outside, words of unknown type.
    has_mask : bool
        The words are those of EVT 2.1.
    """
    high, has_time = state[0], state[2] > 0
    for i in range(len(words)):
        mask = np.uint32(1)
        word = np.uint32(words[i])
        if has_mask:
            mask, word = word, np.uint32(np.uint64(words[i]) >> np.uint64(32))
        kind = word >> 28
        if kind == TIME_HIGH:
            new_high = np.int64(word & 0xFFFFFFF)
            high = advance(high, new_high, 1 << 28) if has_time else new_high
            has_time = True
        elif kind == CD_OFF or kind == CD_ON:
            if not has_time:
                continue
            time = (high << 6) | np.int64((word >> 22) & 0x3F)
            column, row = np.int64((word >> 11) & 0x7FF), np.int64(word & 0x7FF)
            while mask:
                if mask & 0xFF == 0:
                    mask >>= np.uint32(8)
                    column += 8
                    continue
                if mask & 1:
                    if 0 <= column < width and 0 <= row < height:
                        k = count[N_EVENT]
                        if k < len(t):
                            x[k], y[k], p[k], t[k] = column, row, kind, time
                        count[N_EVENT] += 1
                    else:
                        count[N_OUTSIDE] += 1
                mask >>= np.uint32(1)
                column += 1
        elif kind == TRIGGER:
            if has_time:
                k = count[N_TRIGGER]
                if k < len(trigger_t):
                    trigger_p[k], trigger_id[k] = word & 1, (word >> 8) & 0x1F
                    trigger_t[k] = (high << 6) | np.int64((word >> 22) & 0x3F)
                count[N_TRIGGER] += 1
        elif kind != OTHERS and kind != CONTINUED and kind != IMU:
            count[N_UNKNOWN] += 1
    state[0], state[2] = high, has_time


@njit(cache=True)
def decode_evt3(words, width, height, x, y, p, t, trigger_p, trigger_t, trigger_id, state, count):
    """Decode EVT 3.0; parameters as those of `decode_evt2`, words uint16."""
    high, low, has_time = state[0], state[1], state[2] > 0
    row, base, polarity = state[3], state[4], state[5]
    for i in range(len(words)):
        word = np.int64(words[i])
        kind = word >> 12
        if kind == TIME_LOW:
            low = word & 0xFFF
        elif kind == TIME_HIGH:
            new_high = word & 0xFFF
            if not has_time:
                high, low, has_time = new_high, 0, True
            elif new_high != high & 0xFFF:
                high, low = advance(high, new_high, 1 << 12), 0
        elif kind == ADDRESS_Y:
            row = word & 0x7FF
        elif kind == ADDRESS_X:
            if not has_time:
                continue
            column = word & 0x7FF
            if 0 <= column < width and 0 <= row < height:
                k = count[N_EVENT]
                if k < len(t):
                    x[k], y[k], p[k], t[k] = column, row, (word >> 11) & 1, (high << 12) | low
                count[N_EVENT] += 1
            else:
                count[N_OUTSIDE] += 1
        elif kind == BASE_X:
            base, polarity = word & 0x7FF, (word >> 11) & 1
        elif kind == MASK_12 or kind == MASK_8:
            size = 12 if kind == MASK_12 else 8
            mask = word & ((1 << size) - 1)
            column = base
            while mask and has_time:
                if mask & 1:
                    if 0 <= column < width and 0 <= row < height:
                        k = count[N_EVENT]
                        if k < len(t):
                            x[k], y[k], p[k], t[k] = column, row, polarity, (high << 12) | low
                        count[N_EVENT] += 1
                    else:
                        count[N_OUTSIDE] += 1
                mask >>= 1
                column += 1
            base += size
        elif kind == TRIGGER:
            if has_time:
                k = count[N_TRIGGER]
                if k < len(trigger_t):
                    trigger_p[k], trigger_id[k] = word & 1, (word >> 8) & 0xF
                    trigger_t[k] = (high << 12) | low
                count[N_TRIGGER] += 1
        elif kind != OTHERS and kind != CONTINUED and kind != CONTINUED_4:
            count[N_UNKNOWN] += 1
    state[0], state[1], state[2], state[3], state[4], state[5] = high, low, has_time, row, base, polarity
