"""`python -m evsdr.design scene.xml`: judge a ring before it is built: what it can tell, and how well."""

import json
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from evsdr import __version__, theory
from evsdr.console import Stages, check_range, parse_definitions, print_table, run_command
from evsdr.errors import InputError
from evsdr.event_pixel import EventPixel
from evsdr.files import atomic_folder, check_folder
from evsdr.records import Schedule


@dataclass(frozen=True)
class Options:
    """Judge a ring of LEDs: what it can tell in principle, and how well for the object of the scene."""

    scene: tyro.conf.Positional[Path]
    """Scene file: camera, LEDs, object."""
    out: Path | None = None
    """Folder for bound.png and design.json; by default out/design_NAME, named after the scene."""
    noise: float = 0.1
    """Relative standard deviation of the thresholds from one event to the next."""
    threshold_on: float = EventPixel.contrast_threshold_on
    """Contrast threshold of ON events, of natural log intensity."""
    threshold_off: float = EventPixel.contrast_threshold_off
    """Contrast threshold of OFF events."""
    refractory_us: float = EventPixel.refractory_us
    """Time after an event until the reference is memorised anew [us]."""
    rounds: int = 6
    """Rounds of the ring."""
    order: tuple[int, ...] | None = None
    """LED of each slot of a round, -1 for none; by default each LED in turn."""
    slot_us: float = 20_000.0
    """Length of a slot [us]."""
    crossfade: float = 1.0
    """Fraction of a slot's end over which an LED fades into the next; 0 is a hard switch."""
    shininess: float = 32.0
    """Blinn-Phong exponent of the gloss."""
    gloss_threshold: float = 0.5
    """Share of the gloss's peak from which it spoils an observation."""
    spp: int = 16
    """Rays per pixel."""
    seed: int = 0
    """Seed of the rays."""
    define: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-D"]), tyro.conf.UseAppendAction] = field(
        default=()
    )
    """name=value for a <default> parameter of the scene file; may be repeated."""


N_NORMAL = 20_000  # over the visible hemisphere, to count clean observations


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("design", Options, command, argv)


def command(options: Options) -> None:
    """Judge, draw, write, print."""
    out = options.out or Path("out") / f"design_{options.scene.stem}"
    check_folder(out)
    design, bound, mask = judge(options)
    with atomic_folder(out) as folder:
        draw(bound, mask, folder / "bound.png")
        (folder / "design.json").write_text(json.dumps(design, indent=2, allow_nan=False) + "\n")
    print_leds(design["leds"])
    for problem in design["problems"]:
        print(f"- {problem}")
    print_table(f"{options.scene}", describe(design))
    print(f"picture: {out / 'bound.png'}; all else in {out / 'design.json'}")


def judge(options: Options):
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
            from evsdr import scene as scenes
            from evsdr.bound import event_pair_bound
        with stages.stage("trace"):
            ring = scenes.load_scene(options.scene, parse_definitions(options.define))
            schedule = make_schedule(options, ring.leds.n_led)
            truth = scenes.surface_maps(ring, options.spp, options.seed)
            if not truth.mask.any():
                raise InputError(
                    f"{options.scene}: the camera does not see the shape object; move one of them."
                )
            signal = scenes.led_images(ring, options.spp, options.seed)
            illumination, _ = scenes.trace_illumination(ring, options.spp, True, options.seed)
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


def check_options(options: Options) -> EventPixel:
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


def make_schedule(options: Options, n_led: int) -> Schedule:
    """Give the schedule of a ring of n LEDs."""
    order = np.arange(n_led, dtype=np.int32) if options.order is None else np.array(options.order, np.int32)
    if not order.size or order.min() < -1 or order.max() >= n_led or order.max() < 0:
        raise InputError(f"--order must name LEDs from 0 to {n_led - 1}, or -1 for none; correct it.")
    return Schedule(order, options.slot_us, options.crossfade)


def light_at_centre(ring) -> np.ndarray:
    """Give the light vectors (n_led, 3) at the centre of the object, in the camera frame."""
    import drjit as dr
    import mitsuba as mi

    from evsdr.integrators.ring import camera_frame, mean_vector, rotate

    si = dr.zeros(mi.SurfaceInteraction3f)
    box = next(s for s in ring.scene.shapes() if s.id() == "object").bbox()
    si.p = 0.5 * (box.min + box.max)
    frame = camera_frame(ring.sensor)
    vectors = [rotate(frame, mean_vector(ring.leds, j, si, mi.Bool(True))) for j in range(ring.leds.n_led)]
    return ring.leds.power[:, None] * np.array([np.array(v, float).ravel() for v in vectors])


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


# ---------------------------------------------------------------------- print and draw


def print_leds(leds: list[dict]) -> None:
    """Print the table of the LEDs."""
    table = Table(title="LEDs, seen from the centre of the object")
    for name in ("LED", "band", "nm", "power", "azimuth", "polar angle", "safe from gloss"):
        table.add_column(name, justify="left" if name == "LED" else "right")
    for led in leds:
        table.add_row(
            led["id"],
            str(led["band"]),
            f"{led['centroid_nm']:.0f}",
            f"{led['power']:.3g}",
            f"{led['azimuth_deg']:.1f}",
            f"{led['polar_deg']:.1f}",
            "yes" if led["inside_safe_range"] else "no",
        )
    Console().print(table)


def describe(design: dict) -> list[tuple[str, str]]:
    """Give the rows of the table of figures."""
    safe, bound = design["safe_polar_deg"], design["bound"]
    share = design["constant_light"] / design["median_led_signal"] if design["median_led_signal"] else np.inf

    def figures(name, unit):
        mean, median = bound[f"{name}_mean"], bound[f"{name}_median"]
        return "nothing known" if mean is None else f"{mean:.3g} / {median:.3g}{unit}"

    return [
        ("polar angles safe from gloss [deg]", f"{safe[0]:.2f} to {safe[1]:.2f}" if safe else "none"),
        ("normals that lose a band to gloss and shadow", f"{design['normals_without_clean_band']:.2%}"),
        ("constant light / median LED signal", f"{share:.3g}"),
        ("event pairs per pixel", f"{bound['pairs_per_pixel']:.1f}"),
        ("normals, bound: mean / median", figures("normal_deg", " deg")),
        ("reflectance, bound: mean / median", figures("reflectance", "")),
        ("normals known", f"{bound['share_normal_known']:.1%}"),
        ("reflectances known", f"{bound['share_reflectance_known']:.1%}"),
    ]


def draw(bound, mask: np.ndarray, path: Path) -> None:
    """Draw the bounds of normals and reflectance as maps; grey where nothing is known of the object."""
    from matplotlib.figure import Figure

    angle = np.where(bound.normal_sigma_deg < 180, bound.normal_sigma_deg, np.nan)
    known = bound.reflectance_sigma < 1
    total = np.sum(bound.reflectance_sigma, axis=-1, where=known)
    spread = np.where(known.any(axis=-1), total / np.maximum(known.sum(axis=-1), 1), np.nan)
    figure = Figure(figsize=(10, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    draw_map(figure, left, angle, mask, "normals", "root mean square angle [deg]")
    draw_map(figure, right, spread, mask, "reflectance, mean of the known bands", "standard deviation")
    figure.savefig(path, dpi=120)


def draw_map(figure, axis, values: np.ndarray, mask: np.ndarray, title: str, label: str) -> None:
    """Draw one map with its colour bar."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import LogLocator, NullLocator

    axis.imshow(np.where(mask, 0.75, 1.0), vmin=0, vmax=1, cmap="gray")
    axis.set_title(title)
    axis.axis("off")
    good = values[mask & np.isfinite(values)]
    if good.size:
        low, high = np.percentile(good, [1, 99])
        scale = LogNorm(low, max(high, 1.1 * low))
        image = axis.imshow(np.where(mask, values, np.nan), norm=scale, cmap="viridis")
        bar = figure.colorbar(image, ax=axis, label=label, extend="both")
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.ax.yaxis.set_minor_locator(NullLocator())


if __name__ == "__main__":
    sys.exit(main())
