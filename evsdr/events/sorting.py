"""Events of one pixel after the other, in the order of time."""

import numpy as np
from numba import njit

DIGIT = 11  # bits of the time that are sorted in one pass: their counts fit a core's first cache


@njit(cache=True)
def sort_events(pixel, polarity, t_us, start_us, width):
    """Round times and sort by them: a radix sort, which keeps the order of events at the same time.

    Parameters
    ----------
    pixel : (n_event,) int64
        y * width + x; in order.
    polarity : (n_event,) int8
        +1 or -1.
    t_us : (n_event,) float64
        Time since the start [us].
    start_us : float
        Start [us].
    width : int
        Pixels of a row.

    Returns
    -------
    x, y : (n_event,) uint16
        Column and row.
    p : (n_event,) int8
        1 or 0.
    t : (n_event,) int64
        Time, rounded to the nearest us.
    """
    n, first = len(pixel), np.int64(np.floor(start_us))
    since, tag = np.empty(n, np.int64), np.empty(n, np.int64)
    since_then, tag_then = np.empty_like(since), np.empty_like(tag)
    last = 0
    for i in range(n):
        since[i] = np.int64(np.rint(t_us[i] + start_us)) - first
        tag[i] = 2 * pixel[i] + (polarity[i] > 0)
        last = max(last, since[i])
    shift, count = 0, np.empty(1 << DIGIT, np.int64)
    while last >> shift:
        count[:] = 0
        for i in range(n):
            count[(since[i] >> shift) & (len(count) - 1)] += 1
        before = 0
        for k in range(len(count)):
            count[k], before = before, before + count[k]
        for i in range(n):
            k = (since[i] >> shift) & (len(count) - 1)
            since_then[count[k]], tag_then[count[k]] = since[i], tag[i]
            count[k] += 1
        since, since_then, tag, tag_then = since_then, since, tag_then, tag
        shift += DIGIT
    x, y, p = np.empty(n, np.uint16), np.empty(n, np.uint16), np.empty(n, np.int8)
    for i in range(n):
        row = (tag[i] >> 1) // width
        x[i], y[i], p[i] = (tag[i] >> 1) - row * width, row, tag[i] & 1
        since[i] += first
    return x, y, p, since
