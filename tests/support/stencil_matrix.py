"""Stencils as matrices, by a plain loop over a small image."""

import numpy as np

from evsdr.solve import grid as g

MASK = np.array([[1, 1, 0, 1], [1, 1, 1, 1], [0, 1, 1, 1]], bool)


def matrix_of(stencil):
    """The stencil as a matrix, by a plain loop over the image."""
    number = np.full(MASK.shape, -1)
    number[MASK] = np.arange(MASK.sum())
    out = np.zeros((MASK.sum(), MASK.sum()))
    for row, column in zip(*np.nonzero(MASK)):
        entries = []
        for place, weight in stencil.weight.items():
            dr_, dc = g.PLACE.get(place, (0, 0))
            r, c = row + dr_, column + dc
            inside = 0 <= r < MASK.shape[0] and 0 <= c < MASK.shape[1] and MASK[r, c]
            entries.append((number[r, c], weight) if inside else None)
        if None not in entries:
            for other, weight in entries:
                out[number[row, column], other] += weight
    return out
