"""Large recordings, solved in tiles that overlap: so memory is that of a tile.

What is decided on effects, and what all pixels share, comes from a fit of some blocks of pixels; each tile is then solved
under that. Of pixels that several tiles solve, one tile's word counts.
"""

import gc
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import drjit as dr
import numpy as np

from evsdr.effects.blocks import some_blocks
from evsdr.effects.surface import FittedSurface
from evsdr.effects.world import Fitted, World
from evsdr.events.chosen import events_of
from evsdr.fitting.tiling import Tile, counted, solved
from evsdr.progress import Progress, silent
from evsdr.records import Maps
from evsdr.solve.grid import Grid
from evsdr.solve.solution import OF_PIXEL, Solution

ENOUGH, BLOCK = 12_000, 32  # pixels that tell what all share, and the width of their blocks; guessed
WHOLE_IMAGE = "band_wavelength_nm"  # the only part of maps that has no pixels


def largest(tiles: list[Tile], world: World) -> np.ndarray:
    """Give the masked pixels (height, width) bool of the tile that has most."""
    masks = (solved(world.mask, tile) for tile in tiles)
    return max(masks, key=np.count_nonzero)


def telling(world: World) -> World:
    """Keep the pixels that tell what all share."""
    return replace(world, mask=some_blocks(world.mask, ENOUGH, BLOCK))


def within(world: World, tile: Tile) -> World:
    """Look at a tile only."""
    mask = solved(world.mask, tile)
    recording = replace(world.recording, events=events_of(world.recording.events, mask))
    return replace(
        world, mask=mask, recording=recording, surface=FittedSurface(world.ring, world.surface.bounded)
    )


@dataclass(frozen=True)
class Piece:
    """What a tile tells of its own pixels.

    Attributes
    ----------
    pixel : (n,) int
        Where they lie in the image, row-major.
    fired : (n,) bool
    n_pair : (n,) int
    solution : Solution
    visible : (n_led, n) float32, optional
        What they see of the LEDs, see `Problem`.
    """

    pixel: np.ndarray
    fired: np.ndarray
    n_pair: np.ndarray
    solution: Solution
    visible: np.ndarray | None = None

    @classmethod
    def of(cls, fitted: Fitted, tile: Tile) -> "Piece":
        """Keep what counts."""
        problem, own = fitted.problem, np.zeros(fitted.problem.grid.mask.shape, bool)
        own[tile.own] = True
        row = np.flatnonzero(own.ravel()[problem.pixel])
        pixel = problem.pixel[row]
        n_pair = np.diff(problem.told.offset.astype(np.int64))[pixel]
        solution = fitted.solution.at(row)
        solution = replace(solution, covariance=solution.covariance.astype(np.float32))
        visible = None if problem.visible is None else problem.visible[:, row]
        return cls(pixel, problem.fired[row], n_pair, solution, visible)


def solve_tiles(
    world: World,
    tiles: list[Tile],
    example: Fitted,
    fit: Callable[[World, Progress], Fitted],
    progress: Progress = silent,
) -> Fitted:
    """Solve all tiles and join what they tell.

    Parameters
    ----------
    world : World
        Of all pixels.
    example : Fitted
        The fit of some pixels, which shows what all have alike: it stands for noise and light.
    fit : callable (World, Progress) -> Fitted
        Fits the pixels of a tile.
    progress : callable (detail, share) -> bool, optional
        Told which tile is under way, and the share of them that is done.
    """
    pieces, maps = [], None
    world = replace(world, memo=world.memo.only("trace", "aim"))
    for k, tile in enumerate(tiles, 1):
        which = f"{k} of {len(tiles)}"
        gc.collect()  # of the tile before
        dr.flush_malloc_cache()
        done = (k - 1) / len(tiles)
        fitted = fit(
            within(world, tile),
            lambda detail, _, which=which, done=done: progress(f"{which}, {detail}", done),
        )
        pieces.append(Piece.of(fitted, tile))
        maps = fitted.maps if maps is None else joined(maps, fitted.maps, tile)
        del fitted
    return together(world, example, pieces, maps)


def joined(maps: Maps, new: Maps, tile: Tile) -> Maps:
    """Take over what a tile tells; the first that was fitted has nothing beyond its own."""
    out = {f.name: getattr(maps, f.name) for f in fields(Maps) if f.name != WHOLE_IMAGE}
    for name, image in out.items():
        image[tile.own] = getattr(new, name)[tile.own]
    return replace(maps, **out)


def together(world: World, example: Fitted, pieces: list[Piece], maps: Maps) -> Fitted:
    """Put the pieces of an image in the place of an example's."""
    order = np.argsort(np.concatenate([piece.pixel for piece in pieces]))

    def of_all(values: list):
        return None if values[0] is None else np.concatenate(values)[order]

    pixel, fired, n_pair = (
        of_all([getattr(piece, name) for piece in pieces]) for name in ("pixel", "fired", "n_pair")
    )
    solutions = [piece.solution for piece in pieces]
    solution = replace(
        example.solution,
        **{name: of_all([getattr(solution, name) for solution in solutions]) for name in OF_PIXEL},
        noise=float(np.median([solution.noise for solution in solutions])),
        n_step=example.solution.n_step + sum(solution.n_step for solution in solutions),
    )
    count = np.zeros(world.mask.size, np.int64)
    count[pixel] = n_pair
    n_event = counted(world.recording.events, world.mask)
    told = replace(
        example.problem.told,
        offset=np.append(0, np.cumsum(count)).astype(np.uint32),
        n_event=n_event,
        n_dropped=n_event - int(count.sum()) - int(np.count_nonzero(fired)),
    )
    grid = Grid(world.mask, example.problem.grid.links)
    seen = [piece.visible for piece in pieces]
    visible = None if seen[0] is None else np.concatenate(seen, axis=1)[:, order]
    problem = replace(example.problem, pixel=pixel, fired=fired, grid=grid, told=told, visible=visible)
    return Fitted(problem, solution, maps)
