"""The events of some pixels, and how many each has: in two passes that take no memory beside the result."""

import numpy as np
from numba import njit

from evsdr.records import Events


def count_events(events: Events, shape: tuple[int, int]) -> np.ndarray:
    """Count the events of each pixel (height, width) int64."""
    return _count(events.x, events.y, *shape)


def events_of(events: Events, mask: np.ndarray) -> Events:
    """Keep the events of the masked pixels (height, width) bool."""
    n = int(count_events(events, mask.shape)[mask].sum())
    kept = [np.empty(n, getattr(events, name).dtype) for name in "xypt"]
    _keep(events.x, events.y, events.p, events.t, mask, *kept)
    return Events(*kept)


@njit(cache=True, nogil=True)
def _count(x, y, height, width):
    count = np.zeros((height, width), np.int64)
    for k in range(len(x)):
        count[y[k], x[k]] += 1
    return count


@njit(cache=True, nogil=True)
def _keep(x, y, p, t, mask, x_kept, y_kept, p_kept, t_kept):
    n = 0
    for k in range(len(x)):
        if mask[y[k], x[k]]:
            x_kept[n], y_kept[n], p_kept[n], t_kept[n] = x[k], y[k], p[k], t[k]
            n += 1
