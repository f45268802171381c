"""Depth maps as if they had been integrated."""

import numpy as np

from evsdr.model.view import CameraGeometry
from evsdr.shape.bilateral import facing, lines_of_sight
from evsdr.shape.depth import Depth
from evsdr.shape.laplacian import ends


def joined(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tell which neighbours are both in a mask, along rows and columns."""
    return tuple(np.logical_and(*ends(mask, axis)) for axis in (0, 1))


def make_depth(depth, camera: CameraGeometry, mask=None, normal=(0.0, 0.0, 1.0), tied=None) -> Depth:
    """Give a depth map; all neighbours in the mask are tied if not told otherwise."""
    mask = np.ones(depth.shape, bool) if mask is None else mask
    normal = facing(np.broadcast_to(normal, (*depth.shape, 3)), lines_of_sight(camera, depth.shape))
    ties = joined(mask) if tied is None else tied
    return Depth(np.where(mask, depth, 0), mask, mask.astype(np.int32), camera, normal, ties)


def cut(depth: Depth, *, column: int) -> Depth:
    """Cut a depth map before a column."""
    rows, columns = depth.tied
    columns = columns.copy()
    columns[:, column - 1] = False
    return Depth(depth.depth, depth.mask, depth.component, depth.camera, depth.normal, (rows, columns))
