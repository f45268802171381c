"""How image, camera and ring lie to each other, as normals tell it.

A pixel alone is explained as well by a ring that is turned, or mirrored, with its normal. But slopes of a surface have no
curl, and a known shape has known normals. With slopes s and their derivatives J = ds/dx, a ring that turns normals by L
and an image that is moved by G give J' = L J G^T, whose curl is V . J with V = L^T E G, E = [[0, 1], [-1, 0]]: so one
matrix of second moments of J tells the curl under each hypothesis.
"""

from dataclasses import dataclass

import numpy as np

from evsdr.model.view import CameraGeometry

LONGEST = 64  # blocks along the longer side: means over them tell shape better than noisy pixels
FULL = 0.5  # share of a block's pixels that must be known
CURL = np.array([[0.0, 1.0], [-1.0, 0.0]])
# Those that V may be made of: no turn and turns by 90 degrees, mirrors
TURNS = np.array([CURL, np.eye(2)])
MIRRORS = np.array([[[1.0, 0.0], [0.0, -1.0]], [[0.0, 1.0], [1.0, 0.0]]])


@dataclass(frozen=True)
class Bends:
    """Second moments of how slopes change from place to place.

    Attributes
    ----------
    moments : (4, 4) float
        Of J, row after row, each place counted alike.
    n : int
        Places.
    """

    moments: np.ndarray
    n: int

    def curl(self, ring: np.ndarray | None = None, image: np.ndarray | None = None) -> float:
        """Give the share of curl in all bends, with normals turned by `ring` and the image moved by `image` (2, 2)."""
        ring, image = (np.eye(2) if m is None else m for m in (ring, image))
        v = (ring.T @ CURL @ image).ravel()
        return float(v @ self.moments @ v) / max(np.trace(self.moments), 1e-12)

    def least_curl(self) -> float:
        """Give the least share that any turn or mirror leaves."""
        families = (basis.reshape(2, 4) for basis in (TURNS, MIRRORS))
        least = min(np.linalg.eigvalsh(v @ self.moments @ v.T)[0] for v in families)
        return float(least) / max(np.trace(self.moments), 1e-12)


def bends_of(normal: np.ndarray, known: np.ndarray, camera: CameraGeometry) -> Bends:
    """Measure the bends of normals (height, width, 3) where they are known (height, width)."""
    factor = -(-max(known.shape) // LONGEST)
    slope, there = slopes(normal, known, camera)
    slope, there = pooled(slope, there, factor)
    step = np.array(camera.pixel_size)
    square = there[1:, 1:] & there[1:, :-1] & there[:-1, 1:] & there[:-1, :-1]
    right = 0.5 * (np.diff(slope[1:], axis=1) + np.diff(slope[:-1], axis=1)) / step[0]
    up = -0.5 * (np.diff(slope[:, 1:], axis=0) + np.diff(slope[:, :-1], axis=0)) / step[1]
    bend = np.stack([right, up], axis=-1)[square].reshape(-1, 4)
    if not len(bend):
        return Bends(np.zeros((4, 4)), 0)
    size = np.sum(bend**2, axis=1)
    weight = 1 / (np.median(size) + size + 1e-12)
    return Bends(np.einsum("n,ni,nj->ij", weight, bend, bend) / len(bend), len(bend))


def slopes(normal: np.ndarray, known: np.ndarray, camera: CameraGeometry) -> tuple[np.ndarray, np.ndarray]:
    """Give the gradient of depth, or of its logarithm under perspective, and where it is known."""
    toward = -camera.points(np.ones(known.shape)) if camera.perspective else np.array([0.0, 0.0, 1.0])
    facing = np.sum(normal * toward, axis=-1)
    there = known & (facing > 0.05)
    return -normal[..., :2] / np.where(there, facing, 1)[..., None], there


def pooled(values: np.ndarray, known: np.ndarray, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Average values (height, width, k) over the known pixels of square blocks."""
    if factor == 1:
        return values, known
    height, width = (n // factor * factor for n in known.shape)

    def total(a):
        a = a[:height, :width]
        return a.reshape(height // factor, factor, width // factor, factor, *a.shape[2:]).sum(axis=(1, 3))

    count = total(known.astype(float))
    return total(values * known[..., None]) / np.maximum(count, 1)[..., None], count >= FULL * factor**2


def turn_between(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, float]:
    """Give the turn or mirror (2, 2) that takes vectors (n, 2) to others best, and how well: 1 is exactly."""
    u, size, vt = np.linalg.svd(second.T @ first)
    return u @ vt, float(size.sum() / max(np.sqrt(np.sum(first**2) * np.sum(second**2)), 1e-12))
