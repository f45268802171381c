"""`calibrate directions` and `calibrate powers`: read, estimate, write."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.ndimage import binary_erosion

from evsdr.calibration import ball as balls
from evsdr.calibration import chart as colours
from evsdr.calibration import draw
from evsdr.calibration import patch as patching
from evsdr.calibration.equations import collect_pairs, join, thin
from evsdr.calibration.mirror import find_highlights, led_contrast
from evsdr.calibration.scene_text import find_leds, flatten, include_text, place_led, scale_led
from evsdr.errors import InputError, InputWarning, check_range
from evsdr.files.events_h5 import read_recording
from evsdr.files.mask import read_mask
from evsdr.light.camera import view_of
from evsdr.light.checks import check_film, check_object
from evsdr.light.entry import open_scene
from evsdr.metrics import angular_error_deg
from evsdr.model.view import View, depth_of_origin, pixel_centers
from evsdr.records import Recording

START_LIGHT = 0.05  # C_w to start from where the scene has none, relative to the LEDs
START_RATIO = 10.0  # LED over C_w on a ball, to start from
FAR = 4.0  # distance of an LED to start from, in radii of the ball
MISFIT = 0.5  # noise of the residuals, in thresholds, above which model and events contradict each other
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
    near: bool = False
    radius: float | None = None
    center_z: float = 0.0


def _read_events(path: Path, ring) -> Recording:
    """Read a recording and check that it belongs to the scene."""
    recording = read_recording(path)
    check_film(ring, recording)
    lit = set(recording.schedule.order[recording.schedule.order >= 0].tolist())
    if lit != set(range(ring.leds.n_led)):
        raise InputError(
            f"{path}: schedule/order lights {len(lit)} LEDs but {ring.path} has {ring.leds.n_led}; light each "
            "of them."
        )
    return recording


def _count(recording: Recording) -> np.ndarray:
    """Count the events of each pixel (H, W)."""
    height, width = recording.sensor.height, recording.sensor.width
    where = recording.events.y.astype(np.int64) * width + recording.events.x
    return np.bincount(where, minlength=height * width).reshape(height, width)


def _nominal_light(ring) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give directions (n_led, n, 3), camera frame, fall-off (n_led, n), and where the object is (H, W).

    n is 1 for far LEDs, else the number of pixels that see the object.
    """
    from evsdr.light.tracing import trace_illumination

    light, coverage = trace_illumination(ring, 1, False)
    mask = coverage >= 0.5
    check_object(ring, mask)

    def pick(value) -> np.ndarray:
        array = np.asarray(value, float).reshape(-1, np.asarray(value).shape[-1])
        return array if array.shape[1] == 1 else array[:, mask.ravel()]

    direction = [pick(d).T for d in light.direction]
    gain = [pick(e)[0] / power for e, power in zip(light.irradiance, ring.leds.power)]
    n = max(len(d) for d in direction)
    direction = np.stack([np.broadcast_to(d, (n, 3)) for d in direction])
    return direction, np.stack([np.broadcast_to(g, (n,)) for g in gain]), mask


def _fit_result(solution, n_pixel: int) -> dict:
    if solution.noise > MISFIT:
        warnings.warn(
            InputWarning(
                f"the events scatter by {solution.noise:.0%} of a threshold around the model; check order, "
                "slot_us, "
                "triggers, thresholds, and what the camera saw."
            )
        )
    if not solution.converged:
        warnings.warn(InputWarning("the estimate has not settled; its sigma is too small."))
    return {
        "pixels": n_pixel,
        "pairs": len(solution.residual),
        "relative_threshold_noise": solution.noise,
        "settled": solution.converged,
        "photoreceptor_lag_ms_at_constant_light": {"value": solution.lag_ms, "sigma": solution.lag_ms_sigma},
    }


def directions(
    folder: Path, scene: Path, events: Path, ball: Ball, seed: int = 0, define: dict[str, str] | None = None
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
    ring = open_scene(scene, define)
    view = view_of(ring)
    recording = _read_events(events, ring)
    direction, gain, _ = _nominal_light(ring)
    nominal = direction.mean(axis=1)
    nominal /= np.linalg.norm(nominal, axis=1, keepdims=True)
    outline = _ball_outline(ball, view, recording)
    if ball.surface == "mirror":
        found, image, residual, fit = _mirror(ball, view, recording, outline, len(nominal), seed)
        position = position_sigma = noise = None
    else:
        found, image, pairs = _matt(ball, view, recording, outline, nominal, gain.mean(axis=1), ring, seed)
        fit = _fit_result(found.solution, int(np.count_nonzero(pairs)))
        residual, noise = found.solution.residual, found.solution.noise
        position, position_sigma = found.position, found.position_sigma
        outline = found.outline
        if noise <= MISFIT and not (found.sigma_deg < VAGUE_DEG).all():
            raise InputError(f"{events}: too few events to tell the directions; record more rounds.")
    leds = []
    for j, led in enumerate(find_leds(flatten(scene, define or {}))):
        toward = found.direction[j] @ view.frame
        where = None if position is None else view.point_to_world(position[j])
        if where is not None and led.get("type") == "directional":
            center, _ = balls.place_ball(
                view, outline, ball.radius or 1.0, depth_of_origin(view, ball.center_z)
            )
            led = scale_led(led, float(np.sum((position[j] - center) ** 2)))
        leds.append(place_led(led, toward, where))
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
            entry["position_sigma"] = float(position_sigma[j])
    if ball.surface == "matt":
        result["ball_outline_sigma_pixels"] = found.outline_sigma.tolist()
        result["strength"] = {
            "meaning": "power times reflectance of the ball, mean 1",
            "value": found.strength.tolist(),
            "sigma": found.strength_sigma.tolist(),
        }
        result["constant_light_in_that_unit"] = {
            "value": found.constant_light,
            "sigma": found.constant_light_sigma,
        }
    return result


def _ball_outline(ball: Ball, view: View, recording: Recording) -> np.ndarray:
    shape = (recording.sensor.height, recording.sensor.width)
    if ball.circle:
        return np.array(ball.circle)
    if ball.mask:
        return balls.fit_outline(view, read_mask(ball.mask, shape))
    if ball.surface == "mirror":
        raise InputError("the outline of a mirror ball can't be found from events; give --circle or --mask.")
    return balls.fit_outline(view, balls.firing_mask(_count(recording)))


def _mirror(ball, view, recording, outline, n_led, seed):
    if ball.near:
        raise InputError("a mirror ball tells directions, not distances; use --ball matt with --near.")
    shape = (recording.sensor.height, recording.sensor.width)
    balls.ball_pixels(view, outline, shape, seed)
    found = find_highlights(view, led_contrast(recording, n_led), outline)
    fit = {"highlight_pixels": found.center.tolist(), "highlight_rms_radius_pixels": found.spread.tolist()}
    return found, _count(recording).astype(float), None, fit


def _matt(ball, view, recording, outline, nominal, gain, ring, seed):
    shape = (ring.height, ring.width)
    mask = balls.ball_pixels(view, outline, shape, seed)
    pairs = thin(collect_pairs(recording, mask, np.cumsum(mask).reshape(shape) - 1), seed)
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
        found = balls.solve_near(view, pairs, pixel, outline, start, START_RATIO, radius, depth)
    else:
        found = balls.solve_far(view, pairs, pixel, outline, nominal, START_RATIO)
    image = draw.pixel_mean(found.solution.residual, pairs.cluster, shape)
    return found, image, mask


def powers(
    folder: Path,
    scene: Path,
    tilts: Sequence[str],
    reflectance: str = "0.99",
    tilt_sigma_deg: float = 0.5,
    seed: int = 0,
    define: dict[str, str] | None = None,
) -> dict:
    """Find relative powers and constant light, from a white patch at several tilts.

    Parameters
    ----------
    folder : Path
        Gets rig.xml with both, and residuals.png.
    scene : Path
        Scene file with the camera and the calibrated directions.
    tilts : sequence of str
        For each `events.h5:nx,ny,nz` with the patch's normal, camera frame, and optionally `:mask.png`.
    reflectance : str
        Of the patch: a number, or a CSV of wavelength and reflectance.
    tilt_sigma_deg : float
        How well the normals are known [deg].
    seed, define, returns, raises
        As in `directions`.
    """
    check_range("--seed", seed, 0)
    if not 0 <= tilt_sigma_deg < 45:
        raise InputError(f"--tilt-sigma-deg is {tilt_sigma_deg:g}; give a standard deviation, 0 to 45.")
    ring = open_scene(scene, define)
    direction, gain, seen = _nominal_light(ring)
    band_reflectance = _patch_reflectance(reflectance, ring.leds.band_spectrum)[ring.leds.band]
    patches, parts, numbers, n_point = [], [], [], 0
    for k, text in enumerate(tilts):
        path, normal, mask_path = _parse_patch(text)
        recording = _read_events(path, ring)
        shape = (ring.height, ring.width)
        mask = read_mask(mask_path, shape) if mask_path else _inner(balls.firing_mask(_count(recording)))
        if direction.shape[1] > 1:
            mask = mask & seen
        if not mask.any():
            raise InputError(
                f"{path}: no pixel sees the patch; give a mask, or place the scene's object there."
            )
        chosen = mask[seen] if direction.shape[1] > 1 else slice(None)
        point = n_point + (
            np.cumsum(mask).reshape(shape) - 1 if direction.shape[1] > 1 else np.zeros(shape, int)
        )
        try:
            parts.append(collect_pairs(recording, mask, point))
        except InputError as error:
            raise InputError(
                f"{path}: {error} A patch that all LEDs light alike fires nothing: put dark slots between "
                "them."
            ) from error
        patches.append(
            patching.Patch(normal, direction[:, chosen], gain[:, chosen] * band_reflectance[:, None])
        )
        numbers.append(np.full(len(parts[-1].change), k))
        n_point += patches[-1].gain.shape[1]
    joined = join(parts)
    pairs = thin(joined, seed)
    owner = np.repeat(np.arange(len(patches)), [p.gain.shape[1] for p in patches])[pairs.point]
    nominal = ring.leds.power
    start_light = ring.constant_light or START_LIGHT * nominal.mean()
    found = patching.solve_powers(patches, pairs, nominal, start_light, tilt_sigma_deg)
    leds = [
        scale_led(led, float(found.power[j] / nominal[j]))
        for j, led in enumerate(find_leds(flatten(scene, define or {})))
    ]
    title = "LED powers and constant light of evsdr.calibrate powers; include it before any other default."
    (folder / "rig.xml").write_text(include_text(title, leds, {"constant_light": found.constant_light}))
    draw.draw_powers(
        folder / "residuals.png",
        nominal,
        found.power,
        found.power_sigma,
        owner,
        found.solution.residual,
        found.solution.noise,
    )
    result = {
        "scene": str(scene),
        "unit": "events tell ratios only: the mean power is that of the scene file, C_w is in that unit",
        "constant_light": {"value": found.constant_light, "sigma": found.constant_light_sigma},
        "fit": _fit_result(found.solution, len(np.unique(joined.cluster))),
        "leds": [
            {"id": led.get("id"), "power": float(p), "sigma": float(s), "scene_file": float(n)}
            for led, p, s, n in zip(leds, found.power, found.power_sigma, nominal)
        ],
        "tilts": [
            {
                "patch": text,
                "normal": found.normal[k].tolist(),
                "change_deg": float(found.tilt_change_deg[k]),
                "sigma_deg": float(found.tilt_sigma_deg[k]),
            }
            for k, text in enumerate(tilts)
        ],
    }
    return result


def _inner(mask: np.ndarray) -> np.ndarray:
    """Leave out the border of a patch, whose pixels see it in part."""
    return binary_erosion(mask, np.ones((3, 3)), border_value=1)


def _parse_patch(text: str) -> tuple[Path, np.ndarray, Path | None]:
    """Read `events.h5:nx,ny,nz` or `events.h5:nx,ny,nz:mask.png`."""
    parts = text.split(":")
    at = next((k for k in range(len(parts) - 1, 0, -1) if parts[k].count(",") == 2), None)
    try:
        normal = np.array([float(number) for number in parts[at].split(",")])
        length = np.linalg.norm(normal)
        if at < len(parts) - 2 or not 0 < length < np.inf or normal[2] <= 0:
            raise ValueError
    except (TypeError, ValueError):
        raise InputError(
            f"{text}: write a patch as events.h5:nx,ny,nz with its normal in the camera frame, nz above 0, "
            "and "
            "optionally :mask.png."
        ) from None
    return Path(":".join(parts[:at])), normal / length, Path(parts[-1]) if at == len(parts) - 2 else None


def _patch_reflectance(text: str, band_spectrum: np.ndarray) -> np.ndarray:
    """Give the patch's reflectance in each band, from a number or a CSV."""
    try:
        value = np.full(len(band_spectrum), float(text))
    except ValueError:
        value = colours.project(colours.read_spectra(text), band_spectrum).value[0]
    if not (value > 0).all() or not (value <= colours.LARGEST).all():
        raise InputError(f"--reflectance {text}: it must be above 0, and 0.99 or so for a white patch.")
    return value
