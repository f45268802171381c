"""`calibrate powers`: read, estimate, write."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_erosion

from evsdr.calibration import ball as balls
from evsdr.calibration import chart as colours
from evsdr.calibration import draw
from evsdr.calibration import patch as patching
from evsdr.calibration.ring_recording import (
    NominalLight,
    count_events,
    fit_result,
    nominal_light,
    read_ring_events,
    trim_of,
)
from evsdr.calibration.scene_text import find_leds, flatten, include_text, scale_led
from evsdr.calibration.watched import MOST_EVENTS, Watched, watch
from evsdr.errors import InputError, InputWarning, check_range
from evsdr.files.mask import read_mask
from evsdr.light.entry import open_scene
from evsdr.progress import Progress, silent

TURNED = 2 * np.sqrt(2)  # sigmas of one axis that are two of the angle
START_LIGHT = 0.05  # C_w to start from where the scene has none, relative to the LEDs


def powers(
    folder: Path,
    scene: Path,
    patches: Sequence[str],
    reflectance: str = "0.99",
    tilt_sigma_deg: float = 0.5,
    seed: int = 0,
    define: dict[str, str] | None = None,
    progress: Progress = silent,
) -> dict:
    """Find relative powers and constant light, from a white patch at several tilts.

    Parameters
    ----------
    folder : Path
        Gets rig.xml with both, and residuals.png.
    scene : Path
        Scene file with the camera and the calibrated directions.
    patches : sequence of str
        For each tilt `events.h5:nx,ny,nz` with the patch's normal, camera frame, and optionally `:mask.png`.
    reflectance : str
        Of the patch: a number, or a CSV of wavelength and reflectance.
    tilt_sigma_deg : float
        How well the normals are known [deg].
    seed, define, progress
        As in `leds.directions`, like result and errors.
    """
    check_range("--seed", seed, 0)
    if not patches:
        raise InputError("no patch is named; write each tilt as events.h5:nx,ny,nz.")
    if not 0 <= tilt_sigma_deg < 45:
        raise InputError(f"--tilt-sigma-deg is {tilt_sigma_deg:g}; give a standard deviation, 0 to 45.")
    ring = open_scene(scene, define)
    nominal, power = nominal_light(ring), ring.leds.power
    band_reflectance = _patch_reflectance(reflectance, ring.leds.band_spectrum)[ring.leds.band]
    most = MOST_EVENTS // len(patches)
    tilts, parts = zip(*(_read_tilt(text, ring, nominal, band_reflectance, most, seed) for text in patches))
    first = np.cumsum([0, *(tilt.gain.shape[1] for tilt in tilts)])  # number of each tilt's first point
    parts = [replace(part, point=part.point + n) for part, n in zip(parts, first)]
    start_light = ring.constant_light or START_LIGHT * power.mean()
    found = patching.solve_powers(list(tilts), parts, power, start_light, tilt_sigma_deg, progress)
    _name_moved(patches, found.tilt_change_deg, tilt_sigma_deg)
    leds = [
        scale_led(led, float(factor))
        for led, factor in zip(find_leds(flatten(scene, define or {})), found.power / power)
    ]
    title = "LED powers and constant light of evsdr.calibrate powers; include it before any other default."
    (folder / "rig.xml").write_text(include_text(title, leds, {"constant_light": found.constant_light}))
    by = found.solution
    shown = power, found.power, found.power_sigma, by.part, by.residual, by.noise
    draw.draw_powers(folder / "residuals.png", *shown)
    return {
        "scene": str(scene),
        "unit": "events tell ratios only: the mean power is that of the scene file, C_w is in that unit",
        "constant_light": {"value": found.constant_light, "sigma": found.constant_light_sigma},
        "fit": fit_result(found.solution, parts),
        "leds": [
            {"id": led.get("id"), "power": float(p), "sigma": float(s), "scene_file": float(n)}
            for led, p, s, n in zip(leds, found.power, found.power_sigma, power)
        ],
        "tilts": [
            {
                "patch": text,
                "normal": found.normal[k].tolist(),
                "change_deg": float(found.tilt_change_deg[k]),
                "sigma_deg": float(found.tilt_sigma_deg[k]),
            }
            for k, text in enumerate(patches)
        ],
    }


def _name_moved(patches: Sequence[str], change_deg: np.ndarray, tilt_sigma_deg: float) -> None:
    """Warn of tilts that the events turn by more than two standard deviations of what is told."""
    for text, change in zip(patches, change_deg):
        if change > TURNED * max(tilt_sigma_deg, patching.LEAST_SIGMA_DEG):
            warnings.warn(
                InputWarning(
                    f"{text}: the events turn this tilt by {change:.2g} degrees, more than two sigma of {tilt_sigma_deg:g}; "
                    "check its normal, and the LEDs' directions."
                )
            )


def _read_tilt(
    text: str, ring, nominal: NominalLight, band_reflectance: np.ndarray, most: int, seed: int
) -> tuple[patching.Patch, Watched]:
    """Read one tilt of the patch as the command names it: what its points would give, and its pixels."""
    path, normal, mask_path = _parse_patch(text)
    recording, shape = read_ring_events(path, ring), (ring.height, ring.width)
    mask = read_mask(mask_path, shape) if mask_path else _inner(balls.firing_mask(count_events(recording)))
    if nominal.near:
        mask = mask & nominal.mask
    if not mask.any():
        raise InputError(f"{path}: no pixel sees the patch; give a mask, or place the scene's object there.")
    point = np.cumsum(mask).reshape(shape) - 1 if nominal.near else np.zeros(shape, int)
    try:
        part = watch(recording, mask, point, most, seed)
    except InputError as error:
        raise InputError(
            f"{path}: {error} A patch that all LEDs light alike fires nothing: put dark slots between them."
        ) from error
    chosen = mask[nominal.mask] if nominal.near else slice(None)
    gain = nominal.gain[:, chosen] * (band_reflectance * trim_of(recording, len(nominal.gain)))[:, None]
    return patching.Patch(normal, nominal.direction[:, chosen], gain), part


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
            "and optionally :mask.png."
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
