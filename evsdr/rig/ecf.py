"""Decode ECF, the compression of events in Metavision's HDF5 files (filter 36559, 0x8ECF).

A chunk holds, little-endian: u32 number of events << 2 | flags; the times; then by the flags

    2   y, x and p together, 24 bits per event, four events in three u32, the first on top
    1   runs of y; x and p together, 12 bits per event, four events in three u16
    0   runs of y; x in groups; runs of p

- times: u64 of the first, then a byte per run: step << 4 | length. Length 15: a u16 with the true length
  follows. Step 15: four bits of a long step, lowest first, until a byte whose step is not 15.
- runs of y: u16 y << 5 | length, 31: the true length follows as u16. Runs of p: u8 p << 7 | length, 127: u16.
- groups of x: u16 x << 5 | mask of x + 1 (highest bit) .. x + 5.

Format as in the vendor's codec, github.com/prophesee-ai/hdf5_ecf.
"""

import numpy as np
from numba import njit

FILTER = 0x8ECF
SPARE = 8  # events that a decoder may write after the last
DAMAGED = -1


def decode_chunk(data: bytes, x: np.ndarray, y: np.ndarray, p: np.ndarray, t: np.ndarray) -> int:
    """Decode a chunk.

    Parameters
    ----------
    data : bytes
        As stored.
    x, y, p, t : (room,) uint16, uint16, int8, int64
        Written; SPARE entries more than events.

    Returns
    -------
    int
        Number of events, or DAMAGED.
    """
    padded = np.zeros(len(data) + 16, np.uint8)  # so that reading a little too far finds zeros
    padded[: len(data)] = np.frombuffer(data, np.uint8)
    return int(_decode(padded, len(data), x, y, p, t))


@njit(cache=True, inline="always")
def _u16(data, at):
    return np.int64(data[at]) | np.int64(data[at + 1]) << 8


@njit(cache=True, inline="always")
def _u32(data, at):
    return _u16(data, at) | _u16(data, at + 2) << 16


@njit(cache=True)
def _decode(data, size, x, y, p, t):
    if size < 12:
        return DAMAGED
    head = _u32(data, 0)
    n, flags = head >> 2, head & 3
    if n > len(t) - SPARE or flags == 3:
        return DAMAGED
    at = _decode_times(data, size, n, t)
    if at != DAMAGED and flags == 2:
        at = _decode_yxp(data, at, size, n, x, y, p)
    elif at != DAMAGED:
        at = _decode_runs(data, at, size, n, 2, 5, y)
        if at != DAMAGED and flags == 1:
            at = _decode_xp(data, at, size, n, x, p)
        elif at != DAMAGED:
            at = _decode_x(data, at, size, n, x)
            if at != DAMAGED:
                at = _decode_runs(data, at, size, n, 1, 7, p)
    return n if at != DAMAGED else DAMAGED


@njit(cache=True)
def _decode_times(data, size, n, t):
    """Decode the times; give where they end."""
    time = _u32(data, 4) | _u32(data, 8) << 32
    at, i = 12, 0
    while i < n:
        if at >= size:
            return DAMAGED
        step, length = np.int64(data[at] >> 4), np.int64(data[at] & 15)
        at += 1
        if step == 15:
            shift = 0
            while True:
                time += length << shift
                if data[at] >> 4 != 15:
                    break
                length, shift = np.int64(data[at] & 15), shift + 4
                at += 1
                if at >= size or shift > 60:
                    return DAMAGED
            continue
        time += step
        if length == 15:
            length = _u16(data, at)
            at += 2
        if length > n - i or at > size:
            return DAMAGED
        t[i : i + length] = time
        i += length
    return at


@njit(cache=True)
def _decode_runs(data, at, size, n, width, bits, values):
    """Decode runs of a value from words of `width` bytes with the length in `bits`; give where they end."""
    i = 0
    most = (1 << bits) - 1
    while i < n:
        word = _u16(data, at) if width == 2 else np.int64(data[at])
        at += width
        length = word & most
        if length == most:
            length = _u16(data, at)
            at += 2
        if at > size or length > n - i:
            return DAMAGED
        values[i : i + length] = word >> bits
        i += length
    return at


@njit(cache=True)
def _decode_x(data, at, size, n, x):
    i = 0
    while i < n:
        if at + 2 > size:
            return DAMAGED
        word = _u16(data, at)
        at += 2
        first = word >> 5
        x[i] = first
        i += 1
        for j in range(1, 6):
            if word >> (5 - j) & 1:
                x[i] = first + j
                i += 1
    return at


@njit(cache=True)
def _decode_xp(data, at, size, n, x, p):
    for i in range(0, n, 4):
        if at + 6 > size:
            return DAMAGED
        a, b, c = _u16(data, at), _u16(data, at + 2), _u16(data, at + 4)
        at += 6
        four = (a >> 4, (a & 0xF) | (b >> 8) << 4, (b & 0xFF) | (c >> 12) << 8, c & 0xFFF)
        for j in range(4):
            x[i + j], p[i + j] = four[j] >> 1, four[j] & 1
    return at


@njit(cache=True)
def _decode_yxp(data, at, size, n, x, y, p):
    for i in range(0, n, 4):
        if at + 12 > size:
            return DAMAGED
        a, b, c = _u32(data, at), _u32(data, at + 4), _u32(data, at + 8)
        at += 12
        four = (a >> 8, (a & 0xFF) | (b >> 16) << 8, (b & 0xFFFF) | (c >> 24) << 16, c & 0xFFFFFF)
        for j in range(4):
            y[i + j], x[i + j], p[i + j] = four[j] >> 12 & 0x7FF, four[j] >> 1 & 0x7FF, four[j] & 1
    return at
