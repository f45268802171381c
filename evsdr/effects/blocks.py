"""Some pixels of a fit, in blocks: enough to see what all of them share."""

import numpy as np

from evsdr.effects.world import Fitted
from evsdr.solve.grid import make_grid

BLOCK = 16  # width of a block [pixels]: its pixels have neighbours
ENOUGH = 6000  # pixels; measured on a blob of 256 x 256: 3000, 6000 and all 35,000 tell what they share alike


def sample_of(fitted: Fitted, enough: int = ENOUGH) -> Fitted:
    """Keep some blocks of the pixels."""
    problem = fitted.problem
    return at_some(fitted, some_blocks(problem.grid.mask, enough).ravel()[problem.pixel])


def some_blocks(mask: np.ndarray, enough: int, width: int = BLOCK) -> np.ndarray:
    """Keep blocks of the masked pixels (height, width) bool, as chance has it, until there are enough."""
    block = block_of(mask.shape, width)
    count = np.bincount(block[mask])
    order = np.random.default_rng(0).permutation(len(count))
    chosen = order[: np.searchsorted(np.cumsum(count[order]), enough) + 1]
    return mask & np.isin(block, chosen)


def block_of(shape: tuple[int, int], width: int = BLOCK) -> np.ndarray:
    """Number the block of each pixel (height, width)."""
    row, column = np.indices(shape) // width
    return row * (shape[1] // width + 1) + column


def at_some(fitted: Fitted, chosen: np.ndarray) -> Fitted:
    """Keep some pixels (n_pixel) bool of a fit."""
    if chosen.all():
        return fitted
    problem, solution = fitted.problem, fitted.solution
    mask = np.zeros_like(problem.grid.mask)
    mask.ravel()[problem.pixel[chosen]] = True
    row = np.flatnonzero(chosen)
    return Fitted(problem.at(row, make_grid(mask, type(problem.pairs.first))), solution.at(row), fitted.maps)
