"""LED directions or positions from the events of a matt ball.

The ball's normals follow from its outline, so the light of LED j on pixel x is max(0, n_x . v_j) with three
unknowns v_j: direction times power times the ball's reflectance. The unit is the constant light, as events
tell ratios only. A near LED at p has v = P (p - x) / |p - x|^3. The outline itself is refined too.
"""

from dataclasses import dataclass

import contourpy
import numpy as np
from scipy.ndimage import binary_fill_holes, label

from evsdr.calibration.equations import Estimate, fit_events
from evsdr.calibration.watched import Watched
from evsdr.errors import InputError
from evsdr.model.view import View, pixel_centers
from evsdr.progress import Progress, silent

OUTLINE_SIGMA = 1.0  # of the given outline's centre and radius [pixels]
FIRING = 0.25  # of the median count of events, from which a pixel belongs to the ball
RIM = 0.35  # least cosine between normal and line of sight: nearer the rim a pixel sees too many normals
STEP = 0.05  # of the outline for derivatives [pixels]
FEWEST_PIXELS = 50
MOST_PIXELS = 4000
# Points that average over a pixel, horizons of LEDs too
POINTS = np.array([(x, y) for y in (-1, 0, 1) for x in (-1, 0, 1)]) / 3
COARSE_DEG = 1000.0  # over the radius to the fourth [pixels]: what pixels leave open; measured, 0.6 degrees at 7 pixels


@dataclass(frozen=True)
class BallLights:
    """What a ball tells of the LEDs.

    Attributes
    ----------
    direction : (n_led, 3) float
        Unit vectors from the ball's centre to the LEDs, camera frame.
    sigma_deg : (n_led,) float
        One standard deviation of the direction's angle [deg].
    position : (n_led, 3) float or None
        Places of near LEDs, camera frame [scene units].
    position_sigma : (n_led,) float or None
    strength, strength_sigma : (n_led,) float
        Power times reflectance of the ball, as seen at its centre; the mean is 1.
    constant_light, constant_light_sigma : float
        C_w in that unit.
    outline, outline_sigma : (3,) float
        Column and row of the centre, radius [pixels].
    solution : Estimate
    """

    direction: np.ndarray
    sigma_deg: np.ndarray
    position: np.ndarray | None
    position_sigma: np.ndarray | None
    strength: np.ndarray
    strength_sigma: np.ndarray
    constant_light: float
    constant_light_sigma: float
    outline: np.ndarray
    outline_sigma: np.ndarray
    solution: Estimate


def firing_mask(count: np.ndarray) -> np.ndarray:
    """Find the ball as the largest filled patch of pixels that fire, from the events per pixel (H, W)."""
    firing = count >= max(1.0, FIRING * np.median(count[count > 0]) if count.any() else 1.0)
    number, n = label(firing)
    if n == 0:
        return firing
    largest = np.bincount(number.ravel())[1:].argmax() + 1
    return binary_fill_holes(number == largest)


def fit_outline(view: View, mask: np.ndarray) -> np.ndarray:
    """Fit the outline of a ball's image.

    With perspective it is the cone d . m = 1 of rays d, whose image is an ellipse; its circle is the one
    that the same ball would have on the optical axis.

    Returns
    -------
    (3,) float
        Column and row of the centre, radius [pixels].

    Raises
    ------
    InputError
        The mask touches the film's border, or is too small.
    """
    if np.count_nonzero(mask) < FEWEST_PIXELS:
        raise InputError(
            f"the ball covers {np.count_nonzero(mask)} pixels, too few to find its outline; move the "
            "camera closer "
            "or give --circle."
        )
    if mask[[0, -1]].any() or mask[:, [0, -1]].any():
        raise InputError("the ball's outline leaves the image; show the whole ball, or give --circle.")
    lines = contourpy.contour_generator(z=np.pad(mask, 1).astype(float)).lines(0.5)
    points = max(lines, key=len) - 0.5  # pixel centres are at halves, the padding is one
    kept = np.ones(len(points), bool)
    for _ in range(5):
        outline = _outline_of(view, points[kept])
        off = np.linalg.norm(points - outline[:2], axis=1) - outline[2]
        spread = 1.4826 * np.median(np.abs(off)) + 0.3
        kept = np.abs(off) < 3 * spread
    return outline


def _outline_of(view: View, points: np.ndarray) -> np.ndarray:
    size, center = np.array(view.camera.pixel_size), np.array(view.camera.center)
    if not view.camera.perspective:
        matrix = np.column_stack([2 * points, np.ones(len(points))])  # Kasa 1976: linear circle fit
        cx, cy, rest = np.linalg.lstsq(matrix, np.sum(points**2, axis=1), rcond=None)[0]
        return np.array([cx, cy, np.sqrt(rest + cx**2 + cy**2)])
    _, d = view.rays(points)
    m = np.linalg.lstsq(d, np.ones(len(d)), rcond=None)[0]
    tangent = np.sqrt(max(m @ m - 1, 0))  # |m| is 1 / cos of the cone's half angle
    at = m[:2] / -m[2] / size * [1, -1] + center
    return np.array([*at, tangent / size[0]])


def place_ball(view: View, outline: np.ndarray, radius: float, depth: float) -> tuple[np.ndarray, float]:
    """Give centre (3,), camera frame, and radius [scene units] of the ball with an outline.

    Parameters
    ----------
    radius : float
        True radius; only used with perspective, where it sets the distance.
    depth : float
        Distance of the centre from the camera; only used without perspective.
    """
    size, center = view.camera.pixel_size, view.camera.center
    x, y = (outline[0] - center[0]) * size[0], (center[1] - outline[1]) * size[1]
    if not view.camera.perspective:
        return np.array([x, y, -depth]), float(outline[2] * size[0])
    tangent = outline[2] * size[0]
    axis = np.array([x, y, -1]) / np.sqrt(x * x + y * y + 1)
    return axis * radius * np.sqrt(1 + tangent**2) / tangent, radius


def ball_surface(
    view: View, pixel: np.ndarray, center: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give points and normals (n, 3) that image points see, and the cosine to the line of sight (n,).

    The cosine is 0 where the ray misses.
    """
    origin, d = view.rays(pixel)
    offset = origin - center
    b = np.sum(offset * d, axis=1)
    root = np.sqrt(np.maximum(b * b - np.sum(offset**2, axis=1) + radius**2, 0))
    point = origin + (-b - root)[:, None] * d
    normal = point - center
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return point, normal, root / radius


def ball_pixels(view: View, outline: np.ndarray, shape: tuple[int, int], seed: int) -> np.ndarray:
    """Choose the pixels of the ball that count: away from its rim, at most `MOST_PIXELS`.

    Raises
    ------
    InputError
        The ball is outside the image, or too small.
    """
    height, width = shape
    if not (0 <= outline[0] <= width and 0 <= outline[1] <= height and outline[2] > 0):
        raise InputError(
            f"the ball's outline, centre ({outline[0]:g}, {outline[1]:g}) and radius {outline[2]:g} "
            "pixels, is "
            f"not on the image of {width} x {height} pixels; correct --circle."
        )
    everywhere = pixel_centers(np.ones(shape, bool))
    center, radius = place_ball(view, outline, 1.0, 1.0)
    _, _, cosine = ball_surface(view, everywhere, center, radius)
    inside = np.flatnonzero(cosine > RIM)
    if len(inside) < FEWEST_PIXELS:
        raise InputError(
            f"only {len(inside)} pixels see the ball; {FEWEST_PIXELS} at least are needed: move the camera "
            "closer "
            "or correct --circle."
        )
    if len(inside) > MOST_PIXELS:
        inside = np.random.default_rng(seed).choice(inside, MOST_PIXELS, replace=False)
    mask = np.zeros(height * width, bool)
    mask[inside] = True
    return mask.reshape(shape)


def far_model(view: View, pixel: np.ndarray, outline: np.ndarray, n_led: int):
    """Give the model of far LEDs; each has the unknowns v_j (3,), shared is the shift of the outline (3,)."""
    inside = _inside(pixel)

    def signal(v, shift):
        center, radius = place_ball(view, outline + shift, 1.0, 1.0)
        _, normal, _ = ball_surface(view, inside, center, radius)
        cosine = v @ normal.T
        return _over_pixel(np.maximum(cosine, 0)), _over_pixel((cosine > 0)[..., None] * normal)

    def model(x):
        v, shift = x[:-3].reshape(n_led, 3), x[-3:]
        value, own = signal(v, shift)
        return value, own, _by_outline(lambda s: signal(v, s)[0], shift)

    return model


def near_model(
    view: View, pixel: np.ndarray, outline: np.ndarray, n_led: int, ball_radius: float, depth: float
):
    """Give the model of near LEDs; each has its place, camera frame, and the logarithm of its power."""
    inside = _inside(pixel)

    def signal(own, shift):
        center, radius = place_ball(view, outline + shift, ball_radius, depth)
        point, normal, _ = ball_surface(view, inside, center, radius)
        to_led = own[:, None, :3] - point
        square = np.sum(to_led**2, axis=2)
        cosine = np.sum(to_led * normal, axis=2)
        gain = (cosine > 0) * np.exp(own[:, 3:]) * square**-1.5
        by_place = gain[..., None] * (normal - (3 * cosine / square)[..., None] * to_led)
        value = _over_pixel(gain * cosine)
        return value, np.concatenate([_over_pixel(by_place), value[..., None]], axis=2)

    def model(x):
        own, shift = x[:-3].reshape(n_led, 4), x[-3:]
        value, by_own = signal(own, shift)
        return value, by_own, _by_outline(lambda s: signal(own, s)[0], shift)

    return model


def _inside(pixel: np.ndarray) -> np.ndarray:
    """Give the points in each pixel, pixel after pixel (9 n, 2)."""
    return (pixel[:, None] + POINTS).reshape(-1, 2)


def _over_pixel(value: np.ndarray) -> np.ndarray:
    """Average (n_led, 9 n, ...) over the points of each pixel."""
    return value.reshape(len(value), -1, len(POINTS), *value.shape[2:]).mean(axis=2)


def _by_outline(signal, shift: np.ndarray) -> np.ndarray:
    steps = STEP * np.eye(3)
    return np.stack([(signal(shift + h) - signal(shift - h)) / (2 * STEP) for h in steps], axis=-1)


def solve_far(
    view: View,
    part: Watched,
    pixel: np.ndarray,
    outline: np.ndarray,
    start: np.ndarray,
    strength: float,
    progress: Progress = silent,
) -> BallLights:
    """Find the directions of far LEDs.

    Parameters
    ----------
    part : Watched
        Its points are the rows of `pixel`.
    pixel : (n, 2) float
        Image points on the ball.
    outline : (3,) float
    start : (n_led, 3) float
        Directions to start from.
    strength : float
        Signal of a spot of the ball that faces an LED, over the constant light, to start from.
    progress : callable (detail, share), optional
        Told how far it is.
    """
    n_led = len(start)
    prior = np.append(np.full(3 * n_led, np.inf), np.full(3, OUTLINE_SIGMA))
    x = np.append(strength * start, np.zeros(3))
    found = fit_events([part], far_model(view, pixel, outline, n_led), x, prior, progress=progress)
    v = found.x[:-3].reshape(n_led, 3)
    length = np.linalg.norm(v, axis=1)
    direction = v / length[:, None]
    cov = _blocks(found.covariance, n_led, 3)
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    spread = np.einsum("jab,jbc,jca->j", across, cov, across) / length**2
    by_strength = np.zeros((n_led, len(found.x)))
    for j in range(n_led):
        by_strength[j, 3 * j : 3 * j + 3] = direction[j]
    return _lights(view, found, outline, direction, spread, None, None, length, by_strength)


def solve_near(
    view: View,
    part: Watched,
    pixel: np.ndarray,
    outline: np.ndarray,
    start: np.ndarray,
    strength: float,
    ball_radius: float,
    depth: float,
    progress: Progress = silent,
) -> BallLights:
    """Find the positions of near LEDs; `start` (n_led, 3) are places in the camera frame.

    The other arguments are those of `solve_far`, `place_ball` gives the meaning of `ball_radius` and `depth`.
    """
    n_led = len(start)
    center, _ = place_ball(view, outline, ball_radius, depth)
    power = np.log(strength * np.sum((start - center) ** 2, axis=1))
    prior = np.append(np.full(4 * n_led, np.inf), np.full(3, OUTLINE_SIGMA))
    x = np.append(np.column_stack([start, power]).ravel(), np.zeros(3))
    model = near_model(view, pixel, outline, n_led, ball_radius, depth)
    found = fit_events([part], model, x, prior, progress=progress)
    own = found.x[:-3].reshape(n_led, 4)
    center, _ = place_ball(view, outline + found.x[-3:], ball_radius, depth)
    to_led = own[:, :3] - center
    distance = np.linalg.norm(to_led, axis=1)
    direction = to_led / distance[:, None]
    cov = _blocks(found.covariance, n_led, 4)[:, :3, :3]
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    spread = np.einsum("jab,jbc,jca->j", across, cov, across) / distance**2
    sigma = np.sqrt(np.trace(cov, axis1=1, axis2=2))
    strength = np.exp(own[:, 3]) / distance**2
    by_strength = np.zeros((n_led, len(found.x)))
    for j in range(n_led):
        by_strength[j, 4 * j : 4 * j + 3] = -2 * strength[j] * direction[j] / distance[j]
        by_strength[j, 4 * j + 3] = strength[j]
    return _lights(
        view, found, outline, direction, spread, own[:, :3], sigma, strength, by_strength, distance
    )


def _blocks(covariance: np.ndarray, n_led: int, n_own: int) -> np.ndarray:
    """Give each LED's own covariance (n_led, n_own, n_own)."""
    block = covariance[: n_led * n_own, : n_led * n_own].reshape(n_led, n_own, n_led, n_own)
    return block[np.arange(n_led), :, np.arange(n_led), :]


def _lights(
    view, found, outline, direction, spread, position, position_sigma, strength, by_strength, distance=None
):
    coarse = np.radians(COARSE_DEG) / outline[2] ** 4
    if position is not None:
        position_sigma = np.hypot(position_sigma, coarse * distance)
    mean, by_mean = strength.mean(), by_strength.mean(axis=0)
    relative = (by_strength - (strength / mean)[:, None] * by_mean) / mean
    variance = np.einsum("ja,ab,jb->j", relative, found.covariance, relative)
    return BallLights(
        direction=direction,
        sigma_deg=np.degrees(np.sqrt(spread + coarse**2)),
        position=position,
        position_sigma=position_sigma,
        strength=strength / mean,
        strength_sigma=np.hypot(np.sqrt(variance), coarse * strength / mean),
        constant_light=float(1 / mean),
        constant_light_sigma=float(np.sqrt(by_mean @ found.covariance @ by_mean) / mean**2),
        outline=outline + found.x[-3:],
        outline_sigma=np.sqrt(np.diagonal(found.covariance)[-3:]),
        solution=found,
    )
