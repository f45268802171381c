"""Random numbers of one stream."""

import numpy as np


def draws(draw, n, *given):
    """Draw n times from one stream."""
    state, out = np.uint64(1), []
    for _ in range(n):
        state, *values = draw(state, *given)
        state = np.uint64(state)
        out.append(values)
    return np.array(out)
