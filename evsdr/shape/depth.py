"""Depth from normals: weighted, robust integration on the pixel grid.

Two neighbouring pixels i and j with surface points P_i, P_j and normals n_i, n_j obey the chord rule

    (n_i + n_j) . (P_j - P_i) = 0,

exact for planes and spheres and of second order for all smooth surfaces, under either projection. With
P = (x, y, -t) it gives the difference of depth t between neighbours of an orthographic camera; with
P = t (x, y, -1) that of log t under perspective (log depth as unknown: Durou and Courteille 2007,
"Integration of a Normal Field without Boundary Condition"). Depth minimises the weighted squares of all
these differences over the mask (Queau, Durou and Aujol 2018, "Normal Integration: A Survey"): no boundary
condition, and one free offset for each connected component.

Depth discontinuities and wrong normals violate the rule strongly at few places. Iteratively reweighted
least squares with the Welsch weight exp(-e^2 / 2 s^2) lets them go; the scale s starts wide (graduated
non-convexity, Blake and Zisserman 1987). A non-convex estimator for discontinuities is one choice of Queau,
Durou and Aujol 2018, "Variational Methods for Normal Integration", section 4.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from evsdr.errors import InputError
from evsdr.files.atomic import atomic_path
from evsdr.files.results import write_exr
from evsdr.model.view import CameraGeometry

LEAST_COSINE = 0.05  # normals are tilted at most 87 degrees from the line of sight
SIGMA_FLOOR_DEG = 1.0  # added in quadrature: what the grid can't resolve
SIGMA_EVEN_DEG = 10.0  # normals known better than that count alike in a chord, worse ones less
WELSCH = 3.0  # scale of the weight in robust standard deviations
LEAST_SCALE = 0.2  # of the robust standard deviation, in sigmas of the normals
WIDE_START = 4.0  # times the scale in the first reweighting, halved in each
LEAST_WEIGHT = 1e-4  # of a chord that was let go
MOST_STEPS = 60  # of conjugate gradients
DAMPING = 0.8  # of Jacobi steps
OVERCORRECTION = 1.8  # of the coarse levels: constant pieces are too stiff


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
    """

    depth: np.ndarray
    mask: np.ndarray
    component: np.ndarray
    camera: CameraGeometry

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
    n_reweight: int = 8,
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
        neighbours by weak chords. All alike by default.
    anchor : float or (H, W) float, optional
        Known depth [scene units], such as that of a placeholder: each component is moved (orthographic) or
        scaled (perspective) so that its mean depth is the anchor's mean over it. By default 0 or 1.
    n_reweight : int
        Reweightings. 0 is plain weighted least squares, which smears discontinuities and spreads the error of
        wrong normals.

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
    normal = np.where(mask[..., None], normal, (0.0, 0.0, 1.0))
    variance = np.where(mask, sigma_deg, 0) ** 2 + SIGMA_FLOOR_DEG**2
    difference, lever, sigma = zip(*(_chords(normal, mask, variance, camera, axis) for axis in (0, 1)))
    whole = [(v / s) ** 2 for v, s in zip(lever, sigma)]
    value = _solve(whole, difference, np.zeros(mask.shape), 1e-2 if n_reweight else 1e-5)
    for i in range(n_reweight):
        error = [(np.diff(value, axis=k) - difference[k]) * lever[k] / sigma[k] for k in (0, 1)]
        typical = np.concatenate([np.abs(e[w > 0]) for e, w in zip(error, whole)])
        if typical.size == 0:
            break
        scale = WELSCH * max(1.4826 * np.median(typical), LEAST_SCALE) * max(1.0, WIDE_START / 2**i)
        weight = [w * np.maximum(np.exp(-0.5 * (e / scale) ** 2), LEAST_WEIGHT) for w, e in zip(whole, error)]
        value = _solve(weight, difference, value, 0.2 if i < n_reweight - 1 else 0.04)

    component, n_component = ndimage.label(mask)
    depth = _anchored(value, component, n_component, anchor, camera.perspective)
    return Depth(depth, mask, component, camera)


def write_depth(path: str | Path, depth: Depth) -> None:
    """Write depth as a float EXR with the channel `Z`, 0 outside the mask.

    Raises
    ------
    InputError
        The file can't be written.
    """
    with atomic_path(path) as temporary:
        write_exr(temporary, {"Z": depth.depth})


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


def _chords(normal, mask, variance, camera, axis) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give the chords along an axis, one fewer than pixels.

    Returns
    -------
    difference
        Of depth, or log depth, as the normals tell.
    lever
        Angle between chord and surface [deg] per unit of the difference, |m . r| / |P_j - P_i| with m the
        unit half vector and r the line of sight; 0 at the mask's border.
    sigma
        One standard deviation of that angle [deg].
    """
    first, second = ([slice(None)] * 2 for _ in range(2))
    first[axis], second[axis] = slice(None, -1), slice(1, None)
    i, j = tuple(first), tuple(second)
    place = camera.points(np.ones(mask.shape))
    sight = place if camera.perspective else np.broadcast_to([0.0, 0.0, -1.0], place.shape)
    normal = _facing(normal, sight)
    share = 1 / (1 + variance / SIGMA_EVEN_DEG**2)
    half = share[i][..., None] * normal[i] + share[j][..., None] * normal[j]
    length = np.linalg.norm(half, axis=-1)
    sigma = np.sqrt(share[i] ** 2 * variance[i] + share[j] ** 2 * variance[j]) / np.maximum(length, 1e-6)
    half /= np.maximum(length, 1e-6)[..., None]
    facing = np.maximum(-_dot(half, sight[i]), LEAST_COSINE / 5)
    if camera.perspective:
        ratio = facing / np.maximum(-_dot(half, sight[j]), LEAST_COSINE / 5)
        difference = np.log(ratio)
        chord = ratio[..., None] * sight[j] - sight[i]
    else:
        difference = _dot(half, place[j] - place[i]) / facing
        chord = place[j] - place[i] + difference[..., None] * sight[i]
    lever = np.degrees(facing) / np.sqrt(_dot(chord, chord))
    return difference, np.where(mask[i] & mask[j], lever, 0), sigma


def _facing(normal: np.ndarray, sight: np.ndarray) -> np.ndarray:
    """Normalise, and tilt normals that are seen from the side or from behind toward the camera."""
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    toward = -sight / np.linalg.norm(sight, axis=-1, keepdims=True)
    cosine = _dot(normal, toward)[..., None]
    across = normal - cosine * toward
    sine = np.linalg.norm(across, axis=-1, keepdims=True)
    steepest = np.sqrt(1 - LEAST_COSINE**2) / np.where(sine > 0, sine, 1)
    return np.where(cosine < LEAST_COSINE, LEAST_COSINE * toward + steepest * across, normal)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...k,...k->...", a, b)


def _anchored(value, component, n_component, anchor, perspective) -> np.ndarray:
    """Fix the offset of each component; value is depth, or log depth under perspective."""
    index = np.arange(1, n_component + 1)
    goal = ndimage.mean(np.broadcast_to(anchor, value.shape), component, index)
    if perspective:
        top = ndimage.maximum(value, component, index)
        value = np.exp(value - np.concatenate([[0], top])[component] * (component > 0))
        factor = np.concatenate([[0], goal / ndimage.mean(value, component, index)])
        return factor[component] * value
    offset = np.concatenate([[0], goal - ndimage.mean(value, component, index)])
    return np.where(component > 0, value + offset[component], 0)


def _ends(image: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """View the first and the second pixel of all pairs of neighbours along an axis."""
    return (image[:-1], image[1:]) if axis == 0 else (image[:, :-1], image[:, 1:])


def _solve(weight, difference, start: np.ndarray, drop: float) -> np.ndarray:
    """Minimise sum of weight (value_j - value_i - difference)^2 over all pairs of neighbours.

    Conjugate gradients with one multigrid cycle as preconditioner, until the residual has dropped by the
    factor `drop` in the norm of the preconditioner. Pixels without weight keep their start.

    Parameters
    ----------
    weight, difference : pair of arrays, (H - 1, W) and (H, W - 1)
        Along rows and columns.
    start : (H, W) float
    """
    levels = _hierarchy(*weight)
    value = start.copy()
    pull = np.zeros(start.shape)
    for axis in (0, 1):
        flow = weight[axis] * (difference[axis] - np.diff(value, axis=axis))
        first, second = _ends(pull, axis)
        first -= flow
        second += flow
    direction, previous, first_norm = np.zeros(start.shape), 1.0, None
    for _ in range(MOST_STEPS):
        correction = _cycle(levels, pull)
        norm = np.vdot(pull, correction)
        first_norm = norm if first_norm is None else first_norm
        if norm <= max(drop**2 * first_norm, np.finfo(float).tiny):
            break
        direction = correction + (norm / previous) * direction
        previous = norm
        image = _laplacian(levels[0], direction)
        length = norm / np.vdot(direction, image)
        value += length * direction
        pull -= length * image
    return value


def _hierarchy(rows: np.ndarray, columns: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    """Join 2 x 2 pixels to one again and again: weights of a level are sums of the finer ones.

    Braess 1995, "Towards Algebraic Multigrid for Elliptic Problems of Second Order": aggregation with
    overcorrection as a preconditioner.

    Returns
    -------
    list of (rows, columns, diagonal, smoother)
    """
    levels = []
    while True:
        height, width = len(columns), rows.shape[1]
        diagonal = np.zeros((height, width))
        for axis, weight in enumerate((rows, columns)):
            for pixel in _ends(diagonal, axis):
                pixel += weight
        smoother = np.where(diagonal > 0, DAMPING / np.where(diagonal > 0, diagonal, 1), 0)
        levels.append((rows, columns, diagonal, smoother))
        if height * width == 1:
            return levels
        half = (height + 1) // 2, (width + 1) // 2
        rows = _add_pairs(rows, 1)[1 : 2 * half[0] - 1 : 2]
        columns = _add_pairs(columns, 0)[:, 1 : 2 * half[1] - 1 : 2]


def _add_pairs(image: np.ndarray, axis: int) -> np.ndarray:
    """Add neighbours 0 and 1, 2 and 3 and so on; the last stays alone where their number is odd."""
    return np.add.reduceat(image, np.arange(0, image.shape[axis], 2), axis=axis)


def _laplacian(level, value: np.ndarray) -> np.ndarray:
    """Apply the weighted graph Laplacian."""
    rows, columns, diagonal, _ = level
    image = diagonal * value
    image[:-1] -= rows * value[1:]
    image[1:] -= rows * value[:-1]
    image[:, :-1] -= columns * value[:, 1:]
    image[:, 1:] -= columns * value[:, :-1]
    return image


def _cycle(levels, pull: np.ndarray) -> np.ndarray:
    """One symmetric multigrid V cycle: two Jacobi steps, the coarse correction, two Jacobi steps."""
    smoother = levels[0][-1]
    value = smoother * pull
    if len(levels) == 1:
        return value
    value += smoother * (pull - _laplacian(levels[0], value))
    rest = pull - _laplacian(levels[0], value)
    coarse = _cycle(levels[1:], _add_pairs(_add_pairs(rest, 0), 1))
    fine = np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)
    value += OVERCORRECTION * fine[: pull.shape[0], : pull.shape[1]]
    for _ in range(2):
        value += smoother * (pull - _laplacian(levels[0], value))
    return value
