"""Depth from normals: integration on the pixel grid that keeps jumps.

Depth minimises the weighted squares of the differences between neighbours that `bilateral` tells, over the mask:
no boundary condition, and one free offset for each connected component (Queau, Durou and Aujol 2018, "Normal
Integration: A Survey"). The weights follow the depth by iteratively reweighted least squares (Cao et al. 2022,
"Bilateral Normal Integration"), each round solved by conjugate gradients from the round before.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import ndimage

from evsdr.errors import InputError
from evsdr.files.atomic import atomic_path
from evsdr.files.results import write_exr
from evsdr.model.view import CameraGeometry
from evsdr.shape.bilateral import (
    Pairs,
    believed_sides,
    even_sides,
    facing,
    least_squares,
    lines_of_sight,
    make_pairs,
    tied,
)
from evsdr.shape.laplacian import solve

SETTLED = 0.005  # mean change [pixels] from which depth has settled

COMMENTS = "Z: distance from the camera's plane along its axis [scene units]; 0: not known"


@dataclass(frozen=True)
class Depth:
    """A depth map.

    Attributes
    ----------
    depth : (H, W) float64
        Distance from the camera's plane along its axis [scene units], positive in front; 0 outside the mask.
    mask : (H, W) bool
        Pixels with a depth.
    component : (H, W) int32
        Connected components (four neighbours) from 1 on, 0 outside the mask. Each has its own offset.
    camera : CameraGeometry
    normal : (H, W, 3) float64
        Unit normals that were integrated, none more than 87 degrees off the line of sight.
    tied : (H - 1, W) bool, (H, W - 1) bool
        Whether neighbours along rows and columns lie on one surface; else depth jumps between them.
    """

    depth: np.ndarray
    mask: np.ndarray
    component: np.ndarray
    camera: CameraGeometry
    normal: np.ndarray
    tied: tuple[np.ndarray, np.ndarray]

    def nearer(self, by: float) -> "Depth":
        """Move every component nearer to the camera, by its mean depth."""
        if not self.camera.perspective:
            return replace(self, depth=np.where(self.mask, self.depth - by, 0))
        index = np.arange(1, self.component.max() + 1)
        factor = 1 - by / ndimage.mean(self.depth, self.component, index)
        return replace(self, depth=self.depth * np.concatenate([[0], factor])[self.component])

    @property
    def points(self) -> np.ndarray:
        """Surface points (H, W, 3) in the camera frame [scene units]."""
        return self.camera.points(self.depth)


def integrate_normals(
    normal: np.ndarray,
    mask: np.ndarray,
    camera: CameraGeometry,
    sigma_deg: np.ndarray | None = None,
    anchor: float | np.ndarray | None = None,
    n_reweight: int = 30,
    telling: np.ndarray | None = None,
) -> Depth:
    """Integrate normals to depth.

    Parameters
    ----------
    normal : (H, W, 3) float
        Normals in the camera frame: x right, y up, z toward the camera; row 0 is the top. Of any length.
    mask : (H, W) bool
        Pixels to integrate; nothing outside is looked at.
    camera : CameraGeometry
    sigma_deg : (H, W) float, optional
        One standard deviation of the normals [deg]; 180 where nothing is known: such a pixel hangs on its
        neighbours. All alike by default.
    anchor : float or (H, W) float, optional
        Known depth [scene units], such as that of a placeholder: each component is moved (orthographic) or
        scaled (perspective) so that its mean depth is the anchor's mean over it. By default 0 or 1.
    n_reweight : int
        Reweightings at most. 0 is plain weighted least squares, which smears jumps.
    telling : (H, W) bool, optional
        Pixels of which these are the means, in components that have some; all by default.

    Returns
    -------
    Depth

    Raises
    ------
    InputError
        Shapes differ, the mask is empty, or a value inside it is of no use.
    """
    mask = np.asarray(mask) != 0
    sigma_deg = np.zeros(mask.shape) if sigma_deg is None else np.asarray(sigma_deg, float)
    anchor = np.asarray(float(camera.perspective) if anchor is None else anchor, float)
    normal = np.asarray(normal, float)
    _check(normal, mask, camera, sigma_deg, anchor, n_reweight)
    normal = facing(np.where(mask[..., None], normal, (0.0, 0.0, 1.0)), lines_of_sight(camera, mask.shape))
    pairs = [make_pairs(normal, mask, sigma_deg, camera, axis) for axis in (0, 1)]
    value = _integrate(pairs, mask, camera, n_reweight)
    component, _ = ndimage.label(mask)
    depth = _anchored(value, component, _telling(component, telling), anchor, camera.perspective)
    ties = tuple(tied(p, value, axis) for axis, p in enumerate(pairs))
    return Depth(depth, mask, component, camera, normal, ties)


def write_depth(path: str | Path, depth: Depth) -> None:
    """Write depth as a float EXR with the channel `Z`, 0 outside the mask, which its `comments` say.

    Raises
    ------
    InputError
        The file can't be written.
    """
    with atomic_path(path) as temporary:
        write_exr(temporary, {"Z": depth.depth}, comments=COMMENTS)


def _check(normal, mask, camera, sigma_deg, anchor, n_reweight) -> None:
    if mask.ndim != 2 or normal.shape != (*mask.shape, 3):
        raise InputError(
            f"normal has shape {normal.shape} and mask {mask.shape}; make them (H, W, 3) and (H, W)."
        )
    if sigma_deg.shape != mask.shape:
        raise InputError(f"sigma_deg has shape {sigma_deg.shape}; make it {mask.shape}, like the mask.")
    if anchor.shape not in ((), mask.shape):
        raise InputError(f"anchor has shape {anchor.shape}; give a number or one for each pixel.")
    if not mask.any():
        raise InputError("mask selects no pixel; there is nothing to integrate.")
    length = np.linalg.norm(normal[mask], axis=-1)
    if not (np.isfinite(length) & (length > 0)).all():
        raise InputError("normal is zero or not finite at some pixel of the mask; take the pixel out.")
    if not (np.isfinite(sigma_deg[mask]) & (sigma_deg[mask] >= 0)).all():
        raise InputError("sigma_deg is negative or not finite at some pixel of the mask; write 180 there.")
    anchored = anchor if anchor.ndim == 0 else anchor[mask]
    if not np.isfinite(anchored).all() or (camera.perspective and not (anchored > 0).all()):
        raise InputError("anchor must be finite, and positive for a perspective camera; give the mean depth.")
    if not all(np.isfinite(size) and size > 0 for size in camera.pixel_size):
        raise InputError(f"pixel_size is {camera.pixel_size}; both numbers must be positive.")
    if n_reweight < 0:
        raise InputError(f"n_reweight is {n_reweight}; it must be 0 or more.")


def _integrate(pairs: list[Pairs], mask: np.ndarray, camera: CameraGeometry, n_reweight: int) -> np.ndarray:
    """Give depth, or log depth, but for the offset of each component."""
    sides = [even_sides(p) for p in pairs]
    value = solve(*zip(*map(least_squares, pairs, sides)), np.zeros(mask.shape), 1e-2 if n_reweight else 1e-5)
    change = np.inf
    for i in range(n_reweight):
        last = i == n_reweight - 1 or change < SETTLED
        sides = [believed_sides(p, value, axis) for axis, p in enumerate(pairs)]
        before, value = value, solve(*zip(*map(least_squares, pairs, sides)), value, 0.04 if last else 0.2)
        change = np.abs(value - before)[mask].mean() / min(camera.pixel_size)
        if last:
            break
    return value


def _telling(component: np.ndarray, telling: np.ndarray | None) -> np.ndarray:
    """Keep of each component the pixels that tell, or all where none does."""
    if telling is None:
        return component
    without = np.setdiff1d(component, component[telling])
    return np.where(telling | np.isin(component, without), component, 0)


def _anchored(value, component, telling, anchor, perspective) -> np.ndarray:
    """Fix the offset of each component by those pixels that tell; value is depth, or log depth under perspective."""
    index = np.arange(1, component.max() + 1)
    goal = ndimage.mean(np.broadcast_to(anchor, value.shape), telling, index)
    if perspective:
        top = ndimage.maximum(value, component, index)
        value = np.exp(value - np.concatenate([[0], top])[component] * (component > 0))
        factor = np.concatenate([[0], goal / ndimage.mean(value, telling, index)])
        return factor[component] * value
    offset = np.concatenate([[0], goal - ndimage.mean(value, telling, index)])
    return np.where(component > 0, value + offset[component], 0)
