"""The search on few pixels, from which all the others start."""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.model.arrays import owned, picked
from evsdr.progress import Progress
from evsdr.solve.grid import make_grid, nearest
from evsdr.solve.pair_data import room_for
from evsdr.solve.solution import Data, State
from evsdr.solve.stages import Stage

ENOUGH = 2000  # pixels that are searched, where there are so many; guessed
LARGEST = 4  # pixels from one to the next; guessed: textures must show in them


@dataclass(frozen=True)
class Coarse:
    """Run stages on every few pixels of the image where there are many; the others take over what the nearest of them found.

    Attributes
    ----------
    stages : tuple of Stage
        They must not change which pairs count.
    follow : tuple of Stage
        What all pixels then go through, if few were searched.
    """

    stages: tuple[Stage, ...]
    follow: tuple[Stage, ...] = ()
    name: str = "search"

    def __call__(self, data, state, progress):
        every = min(int(np.sqrt(dr.width(state.theta[0]) / ENOUGH)), LARGEST)
        few = (data, state) if every < 2 else thinned(data, state, every)
        some = _passed(self.stages, *few, progress)
        if every < 2:
            return some
        return _passed(self.follow, data, spread_out(data, state, some, every), progress)


def _passed(stages: tuple[Stage, ...], data: Data, state: State, progress: Progress) -> State:
    for stage in stages:
        state = stage(data, state, progress)
    return state


def lattice(mask: np.ndarray, every: int) -> np.ndarray:
    """Tell which of the masked pixels (n_pixel) bool lie on every few rows and columns."""
    on = np.zeros_like(mask)
    on[::every, ::every] = True
    return on[mask]


def thinned(data: Data, state: State, every: int) -> tuple[Data, State]:
    """Keep the pixels of a lattice, each a neighbour of the next."""
    mask, UInt32 = data.grid.mask, type(data.pairs.first)
    row = owned(UInt32, np.flatnonzero(lattice(mask, every)))
    room = room_for(type(data.room), dr.width(row), data.model.illumination.n_led)
    grid, pairs = make_grid(mask[::every, ::every], UInt32), data.pairs.at(row)
    few = replace(data, model=picked(data.model, row), pairs=pairs, grid=grid, room=room)
    state = replace(state, theta=picked(state.theta, row), pairs=state.pairs.at(row), terms=None)
    dr.eval(few.model, few.pairs, state.theta, state.pairs)
    return few, state


def spread_out(data: Data, before: State, found: State, every: int) -> State:
    """Let all pixels start from the nearest that was searched; thresholds of one tell nothing of the next."""
    mask, Float = data.grid.mask, type(data.constant_light)
    on = lattice(mask, every)
    of = (np.cumsum(on) - 1)[nearest(on, mask)]
    theta = picked(found.theta, owned(type(data.pairs.first), of))
    if found.spread:
        theta[-2:] = [dr.zeros(Float, len(of)) + centre for centre in found.spread[:2]]
    dr.eval(theta)
    return replace(found, theta=theta, pairs=before.pairs, terms=None, n_step=before.n_step + found.n_step)
