"""The surface of each pixel: nine vertices that a pixel shares with the neighbours it is tied to.

A pixel that is tied to none on some side ends there by its own tangent plane: the surface is one-sided at jumps.
"""

import numpy as np

from evsdr.shape.bilateral import lines_of_sight
from evsdr.shape.depth import Depth

LEAST_COSINE = (
    0.2  # to the line of sight, of tangent planes that are followed beyond a pixel's centre; measured
)
MOST_CHANGE = 0.5  # of inverse depth over a pixel, under perspective: it stays positive
HALVES = (-1, 0, 1)  # half pixels from a pixel's centre


def vertex_depth(depth: Depth, off_centre: tuple[float, float]) -> np.ndarray:
    """Give the depth of each pixel's vertices: corners, middles of its sides, and centre.

    Planes are met exactly, and parabolas where all neighbours are tied: half of what the slopes differ by counts
    (cubic Hermite interpolation at the middle).

    Parameters
    ----------
    depth : Depth
    off_centre : (float, float)
        Where the centre's vertex lies instead, in rows and columns [pixels].

    Returns
    -------
    (H, W, 3, 3) float
        Along rows and columns; of use inside the mask.
    """
    value, slope = _planar(depth)
    out = np.empty((*value.shape, 3, 3))
    for row in HALVES:
        for column in HALVES:
            out[..., row + 1, column + 1] = _vertex(value, slope, depth.tied, row, column)
    out[..., 1, 1] += off_centre[0] * slope[0] + off_centre[1] * slope[1]
    return 1 / out if depth.camera.perspective else out


def _planar(depth: Depth) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Give what is linear in image coordinates on planes, and its change per pixel along rows and columns.

    With n . P = c: depth t of P = (x, y, -t); under perspective 1 / t of P = t (x, y, -1).
    """
    camera, normal = depth.camera, depth.normal
    sight = lines_of_sight(camera, depth.mask.shape)
    steepest = LEAST_COSINE * np.linalg.norm(sight, axis=-1)
    facing = np.maximum(-np.einsum("...k,...k->...", normal, sight), steepest)
    slope = -normal[..., 1] / facing * camera.pixel_size[1], normal[..., 0] / facing * camera.pixel_size[0]
    if not camera.perspective:
        return depth.depth, slope
    inverse = 1 / np.where(depth.mask, depth.depth, 1)
    return inverse, tuple(-inverse * np.clip(s, -MOST_CHANGE, MOST_CHANGE) for s in slope)


def _vertex(value, slope, tied, row: int, column: int) -> np.ndarray:
    """Extrapolate to a vertex that lies half pixels from the centre, from all pixels around it that are tied.

    The mean of the pixels' tangent planes; but deviations from the mean slope count half.
    """
    members = _around(tied, row, column)
    count = sum(belongs.astype(float) for belongs in members.values())

    def mean(images):
        return sum(np.where(b, image, 0) for b, image in zip(members.values(), images)) / count

    moved = [[_shifted(image, *place) for image in (value, *slope)] for place in members]
    away = [(row / 2 - r, column / 2 - c) for r, c in members]
    level, *tilt = (mean(images) for images in zip(*moved))
    middle = [mean(steps) for steps in zip(*away)]
    bend = mean([(a - middle[0]) * m[1] + (b - middle[1]) * m[2] for (a, b), m in zip(away, moved)])
    return level + tilt[0] * middle[0] + tilt[1] * middle[1] + bend / 2


def _around(tied, row: int, column: int) -> dict[tuple[int, int], np.ndarray]:
    """Tell which pixels around a vertex belong to the surface of its pixel, by their place from that."""
    ahead = np.pad(tied[0], ((0, 1), (0, 0))), np.pad(tied[1], ((0, 0), (0, 1)))
    own = np.ones((ahead[0].shape), bool)
    if row == column == 0:
        return {(0, 0): own}
    if row == 0 or column == 0:
        axis = 0 if row else 1
        return {(0, 0): own, (row, column): _shifted(ahead[axis], min(row, 0), min(column, 0))}
    rows, rows_beside = (_shifted(ahead[0], min(row, 0), c) for c in (0, column))
    columns, columns_beside = (_shifted(ahead[1], r, min(column, 0)) for r in (0, row))
    return {
        (0, 0): own,
        (row, 0): rows | columns & rows_beside & columns_beside,
        (0, column): columns | rows & columns_beside & rows_beside,
        (row, column): rows & columns_beside | columns & rows_beside,
    }


def _shifted(image: np.ndarray, row: int, column: int) -> np.ndarray:
    """Look at the pixel so many rows and columns further; 0 outside."""
    padded = np.pad(image, 1)
    return padded[1 + row : len(padded) - 1 + row, 1 + column : padded.shape[1] - 1 + column]
