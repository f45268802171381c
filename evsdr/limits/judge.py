"""Judge a ring before it is built: what it can tell in principle, and how well for the object of a scene.

Needs Mitsuba started, see `evsdr.jit.start`.
"""

from dataclasses import dataclass

import numpy as np

from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.integrators.leds import emitter_id
from evsdr.light.checks import check_object
from evsdr.light.ground_truth import surface_maps
from evsdr.light.scene import RingScene
from evsdr.light.tracing import led_images, light_at_centre, trace_illumination
from evsdr.limits import theory
from evsdr.limits.bound import Bound, Limit, find_limit
from evsdr.limits.information import REPEATS, Plan
from evsdr.model.illumination import Illumination
from evsdr.records import Maps, Schedule
from evsdr.solve.shared.rig import Told
from evsdr.solve.unknowns import KNOWN_SIGMA_DEG

HARD_SWITCH = (
    "LEDs switch hard: an event then tells only that its threshold was passed, and the limit takes it for more. Let them "
    "fade into each other."
)
N_NORMAL = 20_000  # over the visible hemisphere, to count clean observations


@dataclass(frozen=True)
class Rendering:
    """The object of a scene under its ring.

    Attributes
    ----------
    truth : Maps
    signal : (n_led, height, width) float
        A_xj.
    illumination : Illumination
        What the LEDs send to each pixel, with cast shadows.
    """

    truth: Maps
    signal: np.ndarray
    illumination: Illumination


def render_object(ring: RingScene, spp: int, seed: int) -> Rendering:
    """Render the object of a scene with some rays per pixel.

    Raises
    ------
    InputError
        The camera does not see it.
    """
    truth = surface_maps(ring, spp, seed)
    check_object(ring, truth.mask)
    signal = led_images(ring, spp, seed)
    illumination, _ = trace_illumination(ring, spp, True, seed)
    return Rendering(truth, signal, illumination)


def limit_of(
    ring: RingScene,
    rendering: Rendering,
    schedule: Schedule,
    rounds: int,
    pixel: EventPixel,
    told: Told = Told(),
    repeats: int = REPEATS,
    seed: int = 0,
) -> Limit:
    """Give the limit of what a recording of some rounds can tell of the object; see `find_limit`.

    Raises
    ------
    InputError
        No pixel of the object fires two events.
    """
    truth, light = rendering.truth, rendering.illumination
    plan = Plan(truth.normal, truth.reflectance, truth.mask, light, schedule, rounds, pixel)
    try:
        return find_limit(plan, told, repeats, seed)
    except InputError as error:
        raise InputError(
            f"{ring.path}: no pixel of the object fires two events; lower the thresholds or the "
            "constant light, or light LEDs of different strength in turn."
        ) from error


def judge(
    ring: RingScene,
    rendering: Rendering,
    limit: Limit,
    schedule: Schedule,
    shininess: float = 32.0,
    gloss_threshold: float = 0.5,
) -> dict:
    """Tell what a ring can identify, which LEDs are safe from gloss, and sum up the limit.

    Parameters
    ----------
    ring : RingScene
    rendering : Rendering
        Of `render_object`.
    limit : Limit
        Of `limit_of`.
    schedule : Schedule
        Which LED is lit when.
    shininess : float
        Blinn-Phong exponent of the gloss.
    gloss_threshold : float
        Share of the gloss's peak from which it spoils an observation.

    Returns
    -------
    dict
        LEDs, problems and numbers, as design.json holds them.
    """
    light, leds, mask = light_at_centre(ring), ring.leds, rendering.truth.mask
    report = theory.check_ring(light, leds.band, schedule.order, ring.constant_light)
    safe = theory.polar_angle_range(shininess, gloss_threshold)
    visited = np.unique(schedule.order[schedule.order >= 0])
    clean = theory.clean_observations(
        theory.hemisphere_normals(N_NORMAL), light[visited], leds.band[visited], shininess, gloss_threshold
    )[:, np.unique(leds.band[visited])]
    lit = rendering.signal[:, mask]
    return {
        "leds": describe_leds(ring, light, safe),
        "problems": [*report.problems, *([] if schedule.crossfade else [HARD_SWITCH])],
        "ratios_per_band": list(report.ratios),
        "safe_polar_deg": safe,
        "exact_safe_polar_deg": theory.exact_polar_angle_range(shininess, gloss_threshold),
        "normals_without_clean_band": float(np.mean((clean == 0).any(axis=1))),
        "constant_light": ring.constant_light,
        "median_led_signal": float(np.median(lit[lit > 0])) if (lit > 0).any() else 0.0,
        "bound": {
            "pixels": int(mask.sum()),
            "pairs_per_pixel": float(limit.n_pair[mask].mean()),
            **summarise_bound(limit.told, mask),
        },
        "bound_shared_unknown": summarise_bound(limit.unknown, mask),
        "shared_sigma": shared_sigma(limit, schedule.slot_us),
    }


def describe_leds(ring: RingScene, light: np.ndarray, safe: tuple[float, float] | None) -> list[dict]:
    """List the LEDs as the centre of the object sees them."""
    power = np.linalg.norm(light, axis=-1)
    polar = np.degrees(np.arctan2(np.hypot(light[:, 0], light[:, 1]), light[:, 2]))
    azimuth = np.degrees(np.arctan2(light[:, 1], light[:, 0])) % 360
    return [
        {
            "id": emitter_id(ring.leds.emitter[j]),
            "band": int(ring.leds.band[j]),
            "centroid_nm": float(ring.leds.band_wavelength_nm[ring.leds.band[j]]),
            "power": float(power[j]),
            "azimuth_deg": float(azimuth[j]),
            "polar_deg": float(polar[j]),
            "inside_safe_range": bool(safe and safe[0] < polar[j] < safe[1]),
        }
        for j in range(ring.leds.n_led)
    ]


def summarise_bound(bound: Bound, mask: np.ndarray) -> dict:
    """Give root mean squares, means and medians of a bound over the pixels that it knows, as a fit would call it known."""
    angle, spread = bound.normal_sigma_deg[mask], bound.reflectance_sigma[mask]
    known, known_band = angle < KNOWN_SIGMA_DEG, spread < 1
    summary = {
        "share_normal_known": float(known.mean()),
        "share_reflectance_known": float(known_band.mean()),
    }
    for name, values in (("normal_deg", angle[known]), ("reflectance", spread[known_band])):
        some = bool(values.size)
        summary[f"{name}_rms"] = float(np.sqrt(np.mean(values**2))) if some else None
        summary[f"{name}_mean"] = float(values.mean()) if some else None
        summary[f"{name}_median"] = float(np.median(values)) if some else None
    return summary


def shared_sigma(limit: Limit, slot_us: float) -> dict:
    """Give how well the events tell what pixels share: powers and thresholds as shares, root mean squares."""
    sigma = limit.shared
    found = {
        "powers": float(np.sqrt(np.mean(sigma.log_power**2))),
        "threshold_on": float(sigma.log_threshold[0]),
        "threshold_off": float(sigma.log_threshold[1]),
        "refractory_us": sigma.refractory * slot_us,
        "leak_per_s": sigma.leak / slot_us * 1e6,
        "directions_deg": float(np.degrees(np.sqrt(np.mean(sigma.tilt**2)))),
    }
    return found if "directions" in limit.names else found | {"directions_deg": None}
