"""Pairs of neighbouring pixels: what their normals tell of the depth between them, and which side to believe.

The tangent plane of either pixel tells where its neighbour lies: with P = (x, y, -t), the difference of depth t
under an orthographic camera; with P = t (x, y, -1), that of log t under perspective (log depth as unknown:
Durou and Courteille 2007). Both together tell it by the chord rule (n_i + n_j) . (P_j - P_i) = 0, exact for
planes and spheres and of second order for all smooth surfaces.

A surface with jumps is smooth on one side of each pixel at least. Cao, Santo, Shi, Okura and Matsushita 2022,
"Bilateral Normal Integration", equations 11 to 16: along each axis the two one-sided differences of a pixel get
the weights w and 1 - w, a sigmoid of how much farther one reaches along the normal than the other.
"""

from dataclasses import dataclass

import numpy as np

from evsdr.model.view import CameraGeometry
from evsdr.shape.laplacian import ends

SHARPNESS = 4.0  # k of the sigmoid, per pixel squared: measured; 2 by Cao et al. 2022, section 5
STEEPNESS = 3  # power of the reach: 2 weighs distances alike, 4 angles, as noise of normals is; measured
EVENLY = 4  # power of how evenly both sides count, with which the chord takes the place of planes; measured
CREASE_DEG = (
    20.0  # between two normals, from which the grid may not resolve what bends between them; measured
)
SIGMA_EVEN_DEG = 5.0  # normals known better than that count alike, worse ones less; measured
LEAST_COSINE = 0.05  # normals are tilted at most 87 degrees from the line of sight
LEAST_FACING = 0.01  # of a plane and the line of sight to a neighbour
LEAST_WEIGHT = 1e-6  # of a side that is not believed
JUMP = 1.0  # pixels off the surface that the normals tell, from which a neighbour is not tied to it; measured


@dataclass(frozen=True)
class Pairs:
    """Pairs of neighbours along one axis, a first and a second pixel; all arrays one shorter than the image.

    Attributes
    ----------
    joined : bool
        Whether both are in the mask.
    plane : (first, second)
        Difference of depth, or log depth, by the tangent plane of either pixel.
    chord
        The same by both.
    reach : (first, second)
        Distance from the tangent plane of either pixel per unit of the difference [pixels].
    chord_reach
        The same from the plane of both.
    smooth
        Whether the surface bends no more between them than the grid resolves, 1 to 0.
    trust : (first, second)
        In the normal of either pixel, 0 to 1.
    """

    joined: np.ndarray
    plane: tuple[np.ndarray, np.ndarray]
    chord: np.ndarray
    reach: tuple[np.ndarray, np.ndarray]
    chord_reach: np.ndarray
    smooth: np.ndarray
    trust: tuple[np.ndarray, np.ndarray]


def make_pairs(
    normal: np.ndarray, mask: np.ndarray, sigma_deg: np.ndarray, camera: CameraGeometry, axis: int
) -> Pairs:
    """Compare neighbours along an axis; normals as from `facing`."""
    place = camera.points(np.ones(mask.shape))
    trust = ends(1 / (1 + (np.where(mask, sigma_deg, 180) / SIGMA_EVEN_DEG) ** 2), axis)
    place, sight, side = (ends(image, axis) for image in (place, lines_of_sight(camera, mask.shape), normal))
    pixel = np.sqrt(np.prod(camera.pixel_size))

    def told(plane):
        facing = [np.maximum(-_dot(plane, s), LEAST_FACING) for s in sight]
        if camera.perspective:
            return np.log(facing[0] / facing[1]), [f / pixel for f in facing]
        return _dot(plane, place[1] - place[0]) / facing[0], [f / pixel for f in facing]

    half = trust[0][..., None] * side[0] + trust[1][..., None] * side[1]
    half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-9)
    (first, reach_first), (second, reach_second), (chord, reach) = (told(n) for n in (*side, half))
    joined = np.logical_and(*ends(mask, axis))
    angle = np.degrees(np.arccos(np.clip(_dot(*side), -1, 1)))
    smooth = np.exp(-((angle / CREASE_DEG) ** 2))
    return Pairs(joined, (first, second), chord, (reach_first[0], reach_second[1]), reach[0], smooth, trust)


def lines_of_sight(camera: CameraGeometry, shape: tuple[int, int]) -> np.ndarray:
    """Give the lines of sight (H, W, 3), of length 1 along the camera's axis."""
    place = camera.points(np.ones(shape))
    return place if camera.perspective else np.broadcast_to([0.0, 0.0, -1.0], place.shape)


def facing(normal: np.ndarray, sight: np.ndarray) -> np.ndarray:
    """Normalise, and tilt normals that are seen from the side or from behind toward the camera."""
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    toward = -sight / np.linalg.norm(sight, axis=-1, keepdims=True)
    cosine = _dot(normal, toward)[..., None]
    across = normal - cosine * toward
    sine = np.linalg.norm(across, axis=-1, keepdims=True)
    steepest = np.sqrt(1 - LEAST_COSINE**2) / np.where(sine > 0, sine, 1)
    return np.where(cosine < LEAST_COSINE, LEAST_COSINE * toward + steepest * across, normal)


def even_sides(pairs: Pairs) -> tuple[np.ndarray, np.ndarray]:
    """Believe both sides alike."""
    return (np.full(pairs.joined.shape, 0.5),) * 2


def believed_sides(pairs: Pairs, value: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Give the weights of a pair's two planes: each pixel believes the side that reaches less far.

    A pixel whose normal is not trusted believes both.
    """
    behind, ahead = np.zeros(value.shape), np.zeros(value.shape)
    difference = np.where(pairs.joined, np.diff(value, axis=axis), 0)
    ends(ahead, axis)[0][...] = pairs.trust[0] * (pairs.reach[0] * difference) ** 2
    ends(behind, axis)[1][...] = pairs.trust[1] * (pairs.reach[1] * difference) ** 2
    weight = 1 / (1 + np.exp(np.clip(SHARPNESS * (ahead - behind), -50, 50)))
    return ends(weight, axis)[0], ends(1 - weight, axis)[1]


def least_squares(pairs: Pairs, sides: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Give weight and difference of each pair.

    Where both sides are believed alike, or hardly differ, the chord rule stands for both planes: a plane alone is
    of first order only.
    """
    first, second = (
        np.maximum(s * t, LEAST_WEIGHT) * r**STEEPNESS for s, t, r in zip(sides, pairs.trust, pairs.reach)
    )
    plane = (first * pairs.plane[0] + second * pairs.plane[1]) / (first + second)
    both = np.maximum(np.minimum(4 * sides[0] * sides[1], 1) ** EVENLY, pairs.smooth)
    return np.where(pairs.joined, first + second, 0), plane + both * (pairs.chord - plane)


def tied(pairs: Pairs, value: np.ndarray, axis: int) -> np.ndarray:
    """Tell which pairs lie on one surface: depth between them is what their normals tell."""
    miss = pairs.chord_reach * (np.diff(value, axis=axis) - pairs.chord)
    return pairs.joined & (np.abs(miss) < JUMP)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...k,...k->...", a, b)
