"""`calibrate from-fit`: LEDs as a fit found them, for the next scene."""

from pathlib import Path

import numpy as np

from evsdr.calibration import draw
from evsdr.calibration.ring_recording import nominal_light
from evsdr.calibration.scene_text import find_leds, flatten, include_text, place_led, scale_led
from evsdr.errors import InputError
from evsdr.files.json_text import read_json
from evsdr.light.camera import view_of
from evsdr.light.entry import open_scene
from evsdr.solve.shared.rig import across

WANTED = "the summary.json of a fit of this scene"


def from_fit(folder: Path, scene: Path, results: Path, define: dict[str, str] | None = None) -> dict:
    """Write LEDs with the powers and directions that a fit found.

    Parameters
    ----------
    folder : Path
        Gets rig.xml and residuals.png.
    scene : Path
        Scene file of the fit.
    results : Path
        Its summary.json, or the folder that holds it.
    define : dict, optional
        Values for the `<default>` parameters of the scene file, as for the fit.

    Raises
    ------
    InputError
        The files don't belong together, or the fit took the LEDs as told.
    """
    path = results / "summary.json" if results.is_dir() else results
    summary = read_json(path, WANTED)
    effects = summary.get("effects") if isinstance(summary, dict) else None
    ring = open_scene(scene, define)
    n_led = ring.leds.n_led
    powers = _found(path, effects, "LED powers", ("power_factor", "power_factor_sigma"), (n_led,))
    tilts = _found(path, effects, "LED directions", ("tilt_deg", "tilt_sigma_deg"), (n_led, 2))
    if powers is None and tilts is None:
        raise InputError(
            f"{path}: this fit took powers and directions of the LEDs as told, so there is nothing to take over; see "
            "its `effects` for why."
        )
    factor, factor_sigma = (np.ones(n_led), np.zeros(n_led)) if powers is None else powers
    if not (factor > 0).all():
        raise InputError(f"{path}: a power_factor is not above 0; name {WANTED}.")
    leds = find_leds(flatten(scene, define or {}))
    leds = [scale_led(led, float(f)) for led, f in zip(leds, factor)]
    turn, turn_sigma = np.zeros(n_led), np.zeros(n_led)
    if tilts is not None:
        view, told = view_of(ring), nominal_light(ring).mean_direction
        angle = np.radians(tilts[0])
        leds = [
            place_led(led, (d + a @ across(d)) / np.sqrt(1 + a @ a) @ view.frame, None)
            for led, d, a in zip(leds, told, angle)
        ]
        turn, turn_sigma = np.linalg.norm(tilts[0], axis=1), np.linalg.norm(tilts[1], axis=1)
    (folder / "rig.xml").write_text(
        include_text("LEDs as a fit found them, by evsdr.calibrate from-fit.", leds)
    )
    power = ring.leds.power
    draw.draw_found(folder / "residuals.png", power, factor * power, factor_sigma * power, turn, turn_sigma)
    return {
        "scene": str(scene),
        "results": str(path),
        "taken": [name for name, part in (("powers", powers), ("directions", tilts)) if part is not None],
        "leds": [
            {
                "id": led.get("id"),
                "power": float(factor[j] * power[j]),
                "sigma": float(factor_sigma[j] * power[j]),
                "scene_file": float(power[j]),
                "turned_deg": float(turn[j]),
                "turned_sigma_deg": float(turn_sigma[j]),
            }
            for j, led in enumerate(leds)
        ],
    }


def _found(path: Path, effects: object, effect: str, names: tuple[str, str], shape: tuple) -> tuple | None:
    """Read what a fit found, with its sigma; None if it took it as told."""
    try:
        told = effects[effect]
        if not told["modelled"]:
            return None
        value, sigma = (np.asarray(told["found"][part], float) for part in names)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError(f"{path}: it does not tell of {effect}; name {WANTED}.") from None
    if value.shape != shape or sigma.shape != shape:
        raise InputError(
            f"{path}: it tells of {len(value) if value.ndim else 1} LEDs but the scene has {shape[0]}; name {WANTED}."
        )
    if not (np.isfinite(value).all() and np.isfinite(sigma).all() and (sigma >= 0).all()):
        raise InputError(f"{path}: {names[0]} is not finite; name {WANTED}.")
    return value, sigma
