"""LED directions from the highlights on a mirror ball.

While LED j fades in, the pixels around its mirror image fire ON events, and OFF events while it fades out.
The centre of these pixels has the normal n, seen along v, so the light comes from l = 2 (n . v) n - v.
Where an LED fades into its neighbour the two images pull at each other: put dark slots between them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label

from evsdr.calibration.ball import STEP, ball_surface, place_ball
from evsdr.errors import InputError
from evsdr.events.phase import phase
from evsdr.model.view import View, pixel_centers
from evsdr.records import Recording

FEWEST_PIXELS = 2  # of a highlight
KEPT = 0.05  # of the brightest pixel: fainter ones are stray light
WEIGHT_NOISE = 0.3  # of a pixel's contrast, which is counted in thresholds


@dataclass(frozen=True)
class Highlights:
    """What a mirror ball tells of the LEDs.

    Attributes
    ----------
    center : (n_led, 2) float
        Column and row of the highlights [pixels].
    spread : (n_led,) float
        Root mean square radius of the pixels that fire [pixels].
    direction : (n_led, 3) float
        Unit vectors to the LEDs, camera frame.
    sigma_deg : (n_led,) float
        One standard deviation of the direction's angle, from highlight and outline [deg].
    """

    center: np.ndarray
    spread: np.ndarray
    direction: np.ndarray
    sigma_deg: np.ndarray


def led_contrast(recording: Recording, n_led: int) -> np.ndarray:
    """Measure how much brighter each LED makes each pixel: ON events of its rise, OFF events of its fall.

    Returns
    -------
    (n_led, height, width) float
        A / C_w, the signal of the LED over the light without it; 0 where no event fired.
    """
    events, sensor, schedule = recording.events, recording.sensor, recording.schedule
    at, inside = phase(events.t, schedule, recording.round_start_us)
    slot = at.astype(np.int64)
    before, after = schedule.order[slot], np.append(schedule.order, schedule.order[0])[slot + 1]
    if schedule.crossfade == 0:  # a switch is past when its events come
        before, after = schedule.order[slot - 1], schedule.order[slot]
    led = np.where(events.p > 0, after, before)
    good = inside & (led >= 0) & (led < n_led)
    size = sensor.height * sensor.width
    pixel = events.y.astype(np.int64) * sensor.width + events.x
    on, off = (
        np.broadcast_to(np.asarray(c, float), (sensor.height, sensor.width)).ravel()[pixel]
        for c in (sensor.contrast_threshold_on, sensor.contrast_threshold_off)
    )
    change = np.where(events.p > 0, on, off)[good]
    total = np.bincount(led[good] * size + pixel[good], change, n_led * size)
    rounds = np.ptp(events.t[inside]) / schedule.slot_us / len(schedule.order) if inside.any() else 1.0
    lit = max(round(rounds), 1) * np.array(
        [max(np.count_nonzero(schedule.order == j), 1) for j in range(n_led)]
    )
    return np.expm1(total.reshape(n_led, sensor.height, sensor.width) / (2 * lit[:, None, None]))


def find_highlights(
    view: View, contrast: np.ndarray, outline: np.ndarray, outline_sigma: float
) -> Highlights:
    """Find the LEDs' highlights and the directions that they stand for.

    Parameters
    ----------
    contrast : (n_led, height, width) float
        Of `led_contrast`.
    outline : (3,) float
        Column and row of the ball's centre, radius [pixels].
    outline_sigma : float
        Standard deviation of each of them [pixels].

    Raises
    ------
    InputError
        Some LED leaves no highlight on the ball.
    """
    n_led, *shape = contrast.shape
    everywhere = pixel_centers(np.ones(shape, bool))
    on_ball = np.linalg.norm(everywhere - outline[:2], axis=1).reshape(shape) < outline[2]
    center, sigma, spread = np.empty((n_led, 2)), np.empty(n_led), np.empty(n_led)
    for j in range(n_led):
        strength = contrast[j] * on_ball
        piece, n_piece = label(strength > KEPT * strength.max(), structure=np.ones((3, 3)))
        total = np.bincount(piece.ravel(), strength.ravel())
        best = 1 + total[1:].argmax() if n_piece else 0
        if not n_piece or np.count_nonzero(piece == best) < FEWEST_PIXELS:
            raise InputError(
                f"LED {j} leaves no highlight on the ball; check the outline, and that the camera sees the "
                "reflection of every LED."
            )
        chosen = piece == best
        weight, points = strength[chosen], pixel_centers(chosen)
        center[j] = weight @ points / weight.sum()
        spread[j] = np.sqrt(weight @ np.sum((points - center[j]) ** 2, axis=1) / weight.sum())
        n_effective = weight.sum() ** 2 / np.sum(weight**2)
        sigma[j] = np.sqrt((WEIGHT_NOISE * spread[j]) ** 2 / 2 / n_effective + 1 / 12 / n_effective**2)
    direction = reflect(view, center, outline)
    by = [(reflect(view, center + h, outline) - direction) / STEP for h in STEP * np.eye(2)]
    variance = sum(np.sum(d**2, axis=1) for d in by) * sigma**2
    by = [(reflect(view, center, outline + h) - direction) / STEP for h in STEP * np.eye(3)]
    variance += sum(np.sum(d**2, axis=1) for d in by) * outline_sigma**2
    return Highlights(center, spread, direction, np.degrees(np.sqrt(variance)))


def reflect(view: View, pixel: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Give the directions (n, 3), camera frame, that a mirror ball shows at image points (n, 2)."""
    center, radius = place_ball(view, outline, 1.0, 1.0)
    _, normal, _ = ball_surface(view, pixel, center, radius)
    _, d = view.rays(pixel)
    return d - 2 * np.sum(normal * d, axis=1, keepdims=True) * normal
