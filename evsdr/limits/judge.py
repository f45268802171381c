"""Judge a ring before it is built: what it can tell in principle, and how well for the object of a scene."""

from dataclasses import replace

import numpy as np

from evsdr import __version__
from evsdr.errors import InputError, check_range, parse_definitions
from evsdr.events.pixel import EventPixel
from evsdr.limits import theory
from evsdr.progress import Stages
from evsdr.records import Schedule

N_NORMAL = 20_000  # over the visible hemisphere, to count clean observations


def judge(options):
    """Work out all that can be said of a ring.

    Parameters
    ----------
    options : Options
        As on the command line.

    Returns
    -------
    design : dict
        LEDs, problems, numbers; what design.json holds.
    bound : bound.Bound
    mask : (height, width) bool
        Pixels of the object.

    Raises
    ------
    InputError
        Something given can't be used.
    """
    pixel = check_options(options)
    with Stages("design") as stages:
        with stages.stage("start"):
            from evsdr import jit

            jit.start()
            from evsdr.light import scene as scenes
            from evsdr.light.ground_truth import surface_maps
            from evsdr.light.tracing import led_images, light_at_centre, trace_illumination
            from evsdr.limits.bound import event_pair_bound
        with stages.stage("trace"):
            ring = scenes.load_scene(options.scene, parse_definitions(options.define))
            schedule = make_schedule(options, ring.leds.n_led)
            truth = surface_maps(ring, options.spp, options.seed)
            if not truth.mask.any():
                raise InputError(
                    f"{options.scene}: the camera does not see the shape object; move one of them."
                )
            signal = led_images(ring, options.spp, options.seed)
            illumination, _ = trace_illumination(ring, options.spp, True, options.seed)
        with stages.stage("bound"):
            try:
                bound = event_pair_bound(
                    signal,
                    truth.normal,
                    truth.reflectance,
                    truth.mask,
                    illumination,
                    schedule,
                    options.rounds,
                    pixel,
                )
            except InputError as error:
                raise InputError(
                    f"{options.scene}: no pixel of the object fires two events; lower the thresholds or the "
                    "constant light, or light LEDs of different strength in turn."
                ) from error
        light = light_at_centre(ring)
    leds = ring.leds
    report = theory.check_ring(light, leds.band, schedule.order, ring.constant_light)
    safe = theory.polar_angle_range(options.shininess, options.gloss_threshold)
    visited = np.unique(schedule.order[schedule.order >= 0])
    clean = theory.clean_observations(
        theory.hemisphere_normals(N_NORMAL),
        light[visited],
        leds.band[visited],
        options.shininess,
        options.gloss_threshold,
    )[:, np.unique(leds.band[visited])]
    lit = signal[:, truth.mask]
    design = {
        "evsdr": __version__,
        "scene": str(options.scene),
        "leds": describe_leds(ring, light, safe),
        "problems": list(report.problems),
        "ratios_per_band": list(report.ratios),
        "safe_polar_deg": safe,
        "exact_safe_polar_deg": theory.exact_polar_angle_range(options.shininess, options.gloss_threshold),
        "normals_without_clean_band": float(np.mean((clean == 0).any(axis=1))),
        "constant_light": ring.constant_light,
        "median_led_signal": float(np.median(lit[lit > 0])) if (lit > 0).any() else 0.0,
        "bound": summarise(bound, truth.mask),
        "seconds": stages.seconds,
    }
    return design, bound, truth.mask


def check_options(options) -> EventPixel:
    """Check what the scene has no part in, and give the event pixel."""
    for name, least in (("rounds", 1), ("spp", 1), ("seed", 0)):
        check_range(f"--{name}", getattr(options, name), least)
    for name, value, right, what in (
        ("noise", options.noise, 0 < options.noise < np.inf, "a number above 0"),
        ("slot-us", options.slot_us, 0 < options.slot_us < np.inf, "a time above 0"),
        ("crossfade", options.crossfade, 0 <= options.crossfade <= 1, "a number from 0 to 1"),
        ("shininess", options.shininess, 0 < options.shininess < np.inf, "a number above 0"),
        ("gloss-threshold", options.gloss_threshold, 0 < options.gloss_threshold <= 1, "0 to 1, above 0"),
    ):
        if not right:
            raise InputError(f"--{name} is {value:g}; give {what}.")
    return replace(
        EventPixel.ideal(refractory_us=options.refractory_us),
        contrast_threshold_on=options.threshold_on,
        contrast_threshold_off=options.threshold_off,
        event_noise=options.noise,
    )


def make_schedule(options, n_led: int) -> Schedule:
    """Give the schedule of a ring of n LEDs."""
    order = np.arange(n_led, dtype=np.int32) if options.order is None else np.array(options.order, np.int32)
    if not order.size or order.min() < -1 or order.max() >= n_led or order.max() < 0:
        raise InputError(f"--order must name LEDs from 0 to {n_led - 1}, or -1 for none; correct it.")
    return Schedule(order, options.slot_us, options.crossfade)


def describe_leds(ring, light: np.ndarray, safe: tuple[float, float] | None) -> list[dict]:
    """List the LEDs as the centre of the object sees them."""
    from evsdr.integrators.leds import emitter_id

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


def summarise(bound, mask: np.ndarray) -> dict:
    """Give means and medians of a bound over the pixels that it knows."""
    angle, spread = bound.normal_sigma_deg[mask], bound.reflectance_sigma[mask]
    known, known_band = angle < 180, spread < 1
    summary = {
        "pixels": int(mask.sum()),
        "pairs_per_pixel": float(bound.n_pair[mask].mean()),
        "share_normal_known": float(known.mean()),
        "share_reflectance_known": float(known_band.mean()),
    }
    for name, values in (("normal_deg", angle[known]), ("reflectance", spread[known_band])):
        summary[f"{name}_mean"] = float(values.mean()) if values.size else None
        summary[f"{name}_median"] = float(np.median(values)) if values.size else None
    return summary
