"""`calibrate directions`: read, estimate, write."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from evsdr.calibration import ball as balls
from evsdr.calibration import draw
from evsdr.calibration.mirror import find_highlights, led_contrast
from evsdr.calibration.ring_recording import (
    count_events,
    fit_result,
    nominal_light,
    read_ring_events,
    trim_of,
)
from evsdr.calibration.scene_text import find_leds, flatten, include_text, place_led, scale_led
from evsdr.calibration.watched import MOST_EVENTS, watch
from evsdr.errors import InputError, check_range
from evsdr.files.mask import read_mask
from evsdr.light.camera import view_of
from evsdr.light.entry import open_scene
from evsdr.metrics import angular_error_deg
from evsdr.model.view import View, depth_of_origin, pixel_centers
from evsdr.progress import Progress, silent
from evsdr.records import Recording
from evsdr.solve.noise import MISFIT

START_RATIO = 10.0  # LED over C_w on a ball, to start from
FAR = 4.0  # distance of an LED to start from, in radii of the ball
VAGUE_DEG = 10.0  # sigma of a direction above which it is not known


@dataclass(frozen=True)
class Ball:
    """What is told of a ball under the ring.

    Attributes
    ----------
    surface : str
        `matt` or `mirror`; a mirror gives directions only, and its outline can't be found.
    circle : (float, float, float) or None
        Column and row of its centre, and its radius [pixels]; None to find them.
    mask : Path or None
        Image whose non-zero pixels are the ball, to find its outline from; None to find it from the events.
    circle_sigma : float
        How well the outline of a mirror ball is known [pixels].
    near : bool
        Whether to estimate positions instead of directions.
    radius : float or None
        True radius [scene units]; for positions before a perspective camera.
    center_z : float
        How far its centre lies from the scene's origin toward an orthographic camera [scene units].
    """

    surface: Literal["matt", "mirror"] = "matt"
    circle: tuple[float, float, float] | None = None
    mask: Path | None = None
    circle_sigma: float = 0.1
    near: bool = False
    radius: float | None = None
    center_z: float = 0.0


def directions(
    folder: Path,
    scene: Path,
    events: Path,
    ball: Ball,
    seed: int = 0,
    define: dict[str, str] | None = None,
    progress: Progress = silent,
) -> dict:
    """Find where the LEDs are, from a recording of a ball.

    Parameters
    ----------
    folder : Path
        Gets rig.xml and residuals.png.
    scene : Path
        Scene file with the camera, and the LEDs roughly where they are.
    events : Path
        The recording, an events.h5.
    ball : Ball
    seed : int
        Of the choice of events where there are very many.
    define : dict, optional
        Values for the `<default>` parameters of the scene file.
    progress : callable (detail, share), optional
        Told how far it is.

    Returns
    -------
    dict
        Every estimate and its sigma, as calibration.json holds them.

    Raises
    ------
    InputError
        Something given can't be used, or the events don't tell.
    """
    check_range("--seed", seed, 0)
    if not 0 <= ball.circle_sigma < np.inf:
        raise InputError(
            f"--circle-sigma is {ball.circle_sigma:g}; give a standard deviation in pixels, 0 or more."
        )
    ring = open_scene(scene, define)
    view, light = view_of(ring), nominal_light(ring)
    recording = read_ring_events(events, ring)
    nominal = light.mean_direction
    outline = _ball_outline(ball, view, recording)
    if ball.surface == "mirror":
        found, image, fit = _mirror(ball, view, recording, outline, len(nominal), seed)
        position = residual = noise = None
    else:
        found, image, fit = _matt(
            ball, view, recording, outline, nominal, light.gain.mean(axis=1), ring, seed, progress
        )
        position, outline = found.position, found.outline
        residual, noise = found.solution.residual, found.solution.noise
        if noise <= MISFIT and not (found.sigma_deg < VAGUE_DEG).all():
            raise InputError(f"{events}: too few events to tell the directions; record more rounds.")
    leds = find_leds(flatten(scene, define or {}))
    leds = [_moved(led, view, ball, outline, found, position, j) for j, led in enumerate(leds)]
    (folder / "rig.xml").write_text(include_text("LEDs as evsdr.calibrate directions found them.", leds))
    draw.draw_directions(
        folder / "residuals.png", nominal, found.direction, found.sigma_deg, image, residual, noise
    )
    change = angular_error_deg(found.direction, nominal)
    result = {
        "scene": str(scene),
        "events": str(events),
        "frame": "direction: camera frame, x right, y up, z toward the camera, from the ball's centre; "
        "position: world",
        "ball_outline_pixels": np.asarray(outline).tolist(),
        "fit": fit,
        "leds": [
            {
                "id": led.get("id"),
                "direction": found.direction[j].tolist(),
                "sigma_deg": float(found.sigma_deg[j]),
                "change_deg": float(change[j]),
            }
            for j, led in enumerate(leds)
        ],
    }
    if position is not None:
        for j, entry in enumerate(result["leds"]):
            entry["position"] = view.point_to_world(position[j]).tolist()
            entry["position_sigma"] = float(found.position_sigma[j])
    trim = trim_of(recording, len(nominal))
    return result | (_strength(found, trim) if ball.surface == "matt" else {})


def _moved(led, view: View, ball: Ball, outline, found, position, j: int):
    """Give the element of LED j where it was found."""
    if position is None:
        return place_led(led, found.direction[j] @ view.frame, None)
    if led.get("type") == "directional":
        depth = depth_of_origin(view, ball.center_z)
        center, _ = balls.place_ball(view, outline, ball.radius or 1.0, depth)
        led = scale_led(led, float(np.sum((position[j] - center) ** 2)))
    return place_led(led, found.direction[j] @ view.frame, view.point_to_world(position[j]))


def _strength(found: balls.BallLights, trim: np.ndarray) -> dict:
    """Give what calibration.json holds of a matt ball's outline and of the LEDs' strength, without their trim."""
    light = {"value": found.constant_light, "sigma": found.constant_light_sigma}
    return {
        "ball_outline_sigma_pixels": found.outline_sigma.tolist(),
        "strength": {
            "meaning": "power times reflectance of the ball, mean 1 as it was lit",
            "value": (found.strength / trim).tolist(),
            "sigma": (found.strength_sigma / trim).tolist(),
        },
        "constant_light_in_that_unit": light,
    }


def _ball_outline(ball: Ball, view: View, recording: Recording) -> np.ndarray:
    shape = (recording.sensor.height, recording.sensor.width)
    if ball.circle:
        return np.array(ball.circle)
    if ball.mask:
        return balls.fit_outline(view, read_mask(ball.mask, shape))
    if ball.surface == "mirror":
        raise InputError("the outline of a mirror ball can't be found from events; give --circle or --mask.")
    return balls.fit_outline(view, balls.firing_mask(count_events(recording)))


def _mirror(ball, view, recording, outline, n_led, seed):
    if ball.near:
        raise InputError("a mirror ball tells directions, not distances; use --ball matt with --near.")
    shape = (recording.sensor.height, recording.sensor.width)
    balls.ball_pixels(view, outline, shape, seed)
    found = find_highlights(view, led_contrast(recording, n_led), outline, ball.circle_sigma)
    fit = {"highlight_pixels": found.center.tolist(), "highlight_rms_radius_pixels": found.spread.tolist()}
    return found, count_events(recording).astype(float), fit


def _matt(ball, view, recording, outline, nominal, gain, ring, seed, progress):
    shape = (ring.height, ring.width)
    mask = balls.ball_pixels(view, outline, shape, seed)
    part = watch(recording, mask, np.cumsum(mask).reshape(shape) - 1, MOST_EVENTS, seed)
    pixel = pixel_centers(mask)
    depth = depth_of_origin(view, ball.center_z)
    if ball.near:
        if view.camera.perspective and not ball.radius:
            raise InputError("--near with a perspective camera needs --radius, the true radius of the ball.")
        radius = ball.radius or 1.0
        _, size = balls.place_ball(view, outline, radius, depth)
        far = np.array([ring.leds.is_far(j) for j in range(ring.leds.n_led)])
        distance = np.where(far, FAR * size, 1 / np.sqrt(np.maximum(gain, 1e-12)))
        start = view.point_to_camera(np.zeros(3)) + distance[:, None] * nominal
        found = balls.solve_near(view, part, pixel, outline, start, START_RATIO, radius, depth, progress)
    else:
        found = balls.solve_far(view, part, pixel, outline, nominal, START_RATIO, progress)
    image = draw.pixel_mean(found.solution.residual, found.solution.pixel, shape)
    return found, image, fit_result(found.solution, [part])
