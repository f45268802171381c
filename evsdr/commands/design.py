"""`python -m evsdr.design scene.xml`: judge a ring before it is built: what it can tell, and how well."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from evsdr import __version__, jit
from evsdr.commands.console import print_table, run_command
from evsdr.commands.pixel import Pixel
from evsdr.errors import InputError, check_range, parse_definitions
from evsdr.events.pixel import EventPixel
from evsdr.files.atomic import atomic_folder, atomic_path, check_folder
from evsdr.limits.drawing import ring_drawing
from evsdr.progress import Plan, Stages
from evsdr.records import Schedule
from evsdr.solve.shared.rig import Told


@dataclass(frozen=True)
class Options:
    """Judge a ring of LEDs: what it can tell in principle, and how well for the object of the scene."""

    scene: tyro.conf.Positional[Path]
    """Scene file: camera, LEDs, object."""
    out: Path | None = None
    """Folder for bound.png and design.json; by default out/design_NAME, named after the scene."""
    pixel: Pixel = Pixel()
    """The event pixel; by default that of an EVK4."""
    ideal: bool = False
    """Leave out spread, lag and shot noise; thresholds, event noise and refractory period stay."""
    rounds: int = 6
    """Rounds of the ring."""
    order: tuple[int, ...] | None = None
    """LED of each slot of a round, -1 for none; by default each LED in turn."""
    slot_us: float = 20_000.0
    """Length of a slot [us]."""
    crossfade: float = 1.0
    """Fraction of a slot's end over which an LED fades into the next; 0 is a hard switch."""
    leds_told_to: float = 0.0
    """How well the scene tells the directions of far LEDs: one standard deviation [deg]; 0 takes them as told."""
    drawing: Path | None = None
    """Write a drawing of the ring too: an SVG in millimetres, with each LED's place."""
    led_distance_mm: float = 150.0
    """Distance of the LEDs from the centre of the object in that drawing [mm]."""
    shininess: float = 32.0
    """Blinn-Phong exponent of the gloss."""
    gloss_threshold: float = 0.5
    """Share of the gloss's peak from which it spoils an observation."""
    spp: int = 16
    """Rays per pixel."""
    seed: int = 0
    """Seed of the rays, and of the events that are simulated."""
    define: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-D"]), tyro.conf.UseAppendAction] = field(
        default=()
    )
    """name=value for a <default> parameter of the scene file; may be repeated."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("design", Options, command, argv)


def command(options: Options) -> None:
    """Judge, draw, write, print."""
    out = options.out or Path("out") / f"design_{options.scene.stem}"
    check_folder(out)
    pixel = check_options(options)
    with Stages("design", Plan({"start": 1.0, "trace": 1.0, "bound": 8.0})) as stages:
        with stages.stage("start"):
            jit.start()
            from evsdr.light.scene import load_scene
            from evsdr.limits.judge import judge, limit_of, render_object
        with stages.stage("trace"):
            ring = load_scene(options.scene, parse_definitions(options.define))
            schedule = make_schedule(options, ring.leds.n_led)
            rendering = render_object(ring, options.spp, options.seed)
        with stages.stage("bound"):
            told = Told(directions_deg=options.leds_told_to)
            limit = limit_of(ring, rendering, schedule, options.rounds, pixel, told, seed=options.seed)
    mask = rendering.truth.mask
    design = {
        "evsdr": __version__,
        "scene": str(options.scene),
        **judge(ring, rendering, limit, schedule, options.shininess, options.gloss_threshold),
        "seconds": stages.seconds,
    }
    with atomic_folder(out, "design.json") as folder:
        draw(limit.told, mask, folder / "bound.png")
        (folder / "design.json").write_text(json.dumps(design, indent=2, allow_nan=False) + "\n")
    if options.drawing:
        with atomic_path(options.drawing) as temporary:
            temporary.write_text(ring_drawing(design["leds"], options.led_distance_mm), encoding="utf-8")
    print_leds(design["leds"])
    for problem in design["problems"]:
        print(f"- {problem}")
    print_table(f"{options.scene}", describe(design))
    print(f"picture: {out / 'bound.png'}; all else in {out / 'design.json'}")


def check_options(options: Options) -> EventPixel:
    """Check what the scene has no part in, and give the event pixel."""
    if options.drawing and not options.drawing.parent.is_dir():
        raise InputError(
            f"{options.drawing.parent}: there is no such folder; make it, or give another --drawing."
        )
    for name, least in (("rounds", 1), ("spp", 1), ("seed", 0)):
        check_range(f"--{name}", getattr(options, name), least)
    for name, value, right, what in (
        ("slot-us", options.slot_us, 0 < options.slot_us < np.inf, "a time above 0"),
        ("leds-told-to", options.leds_told_to, 0 <= options.leds_told_to < 45, "degrees, 0 to 45"),
        ("crossfade", options.crossfade, 0 <= options.crossfade <= 1, "a number from 0 to 1"),
        ("shininess", options.shininess, 0 < options.shininess < np.inf, "a number above 0"),
        (
            "led-distance-mm",
            options.led_distance_mm,
            0 < options.led_distance_mm < 1e5,
            "millimetres above 0",
        ),
        ("gloss-threshold", options.gloss_threshold, 0 < options.gloss_threshold <= 1, "0 to 1, above 0"),
    ):
        if not right:
            raise InputError(f"--{name} is {value:g}; give {what}.")
    pixel = options.pixel.idealised() if options.ideal else options.pixel
    if not (pixel.event_noise > 0 or pixel.photon_rate_per_us > 0):
        raise InputError("--event-noise is 0, so nothing would limit the events; give a number above 0.")
    return pixel


def make_schedule(options: Options, n_led: int) -> Schedule:
    """Give the schedule of a ring of n LEDs."""
    from evsdr.events.record import ring_schedule

    schedule = ring_schedule(n_led, options.order, options.slot_us, options.crossfade)
    order = schedule.order
    if not order.size or order.min() < -1 or order.max() >= n_led or order.max() < 0:
        raise InputError(f"--order must name LEDs from 0 to {n_led - 1}, or -1 for none; correct it.")
    return schedule


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

    def figures(name, unit, bound=bound):
        values = bound[f"{name}_rms"], bound[f"{name}_median"]
        return "nothing known" if values[0] is None else f"{values[0]:.3g} / {values[1]:.3g}{unit}"

    shared = [
        (f"{name}, limit, LEDs and thresholds unknown", figures(key, unit, design["bound_shared_unknown"]))
        for name, key, unit in (("normals", "normal_deg", " deg"), ("reflectance", "reflectance", ""))
    ]
    return [
        ("polar angles safe from gloss [deg]", f"{safe[0]:.2f} to {safe[1]:.2f}" if safe else "none"),
        ("normals that lose a band to gloss and shadow", f"{design['normals_without_clean_band']:.2%}"),
        ("constant light / median LED signal", f"{share:.3g}"),
        ("event pairs per pixel", f"{bound['pairs_per_pixel']:.1f}"),
        ("normals, limit: root mean square / median", figures("normal_deg", " deg")),
        ("reflectance, limit: root mean square / median", figures("reflectance", "")),
        *shared,
        ("normals known", f"{bound['share_normal_known']:.1%}"),
        ("reflectances known", f"{bound['share_reflectance_known']:.1%}"),
    ]


def draw(bound, mask: np.ndarray, path: Path) -> None:
    """Draw the bounds of normals and reflectance as maps; grey where nothing is known of the object."""
    from matplotlib.figure import Figure

    from evsdr.solve.unknowns import KNOWN_SIGMA_DEG  # loads Dr.Jit

    angle = np.where(bound.normal_sigma_deg < KNOWN_SIGMA_DEG, bound.normal_sigma_deg, np.nan)
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
