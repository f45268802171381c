"""`python -m evsdr.simulate scene.xml --out DIR`: record a scene with simulated event pixels."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from evsdr.commands.console import print_table, run_command
from evsdr.commands.pixel import Pixel
from evsdr.errors import InputError, check_range, parse_definitions
from evsdr.files.atomic import atomic_folder, check_folder
from evsdr.progress import Plan, Stages


@dataclass(frozen=True)
class Options:
    """Simulate the recording of a scene, or of a stack of photographs, under a ring of LEDs."""

    scene: tyro.conf.Positional[Path | None] = None
    """Scene file; not with --frames."""
    out: Path = field(kw_only=True)
    """Folder for events.h5 and truth.npz."""
    frames: Path | None = None
    """Photographs with known lights instead of a scene: an .npz, see `evsdr/files/photographs.py`. Writes a
    scene.xml too."""
    constant_light: float | None = None
    """C_w with --frames, 0.05 by default; a scene brings its own."""
    rounds: int = 6
    """Rounds of the ring."""
    order: tuple[int, ...] | None = None
    """LED of each slot of a round, -1 for none; by default each LED in turn."""
    slot_us: float = 20_000.0
    """Length of a slot [us]; in a shorter one the photoreceptor's lag weighs more."""
    crossfade: float = 1.0
    """Fraction of a slot's end over which an LED fades into the next; 0 is a hard switch."""
    flicker: bool = False
    """Instead of the ring, its flicker, as `capture --flicker` records it; shows the object lit by one LED."""
    trim: tuple[float, ...] | None = None
    """Brightness of each LED relative to what the scene says, 0 to 1; by default all 1."""
    led_rise_us: float = 0.0
    """Time constant of an LED's light [us]."""
    pixel: Pixel = Pixel()
    """The event pixel; by default that of an EVK4."""
    ideal: bool = False
    """Leave out spread, lag, shot noise, leak and hot pixels; thresholds, event noise and refractory period
    stay."""
    thresholds: Literal["calibrated", "nominal"] = "calibrated"
    """What events.h5 tells of the thresholds: those of each pixel, or one nominal value."""
    spp: int | None = None
    """Rays per pixel; by default 16, and 64 where LEDs have a surface or light goes by way of others: such noise is not real."""
    seed: int = 0
    """Seed of everything random."""
    define: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-D"]), tyro.conf.UseAppendAction] = field(
        default=()
    )
    """name=value for a <default> parameter of the scene file; may be repeated."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("simulate", Options, command, argv)


def command(options: Options) -> None:
    """Simulate, write, print how much came out."""
    from evsdr.events.record import record
    from evsdr.files import photographs
    from evsdr.files.events_h5 import write_recording
    from evsdr.files.truth import write_truth
    from evsdr.fitting.simulation import render
    from evsdr.light.entry import open_scene

    _check(options)
    with Stages(
        "simulate",
        Plan({"read photographs" if options.frames else "render": 1.0, "events": 3.0, "write": 1.0}),
    ) as stages:
        if options.frames:
            with stages.stage("read photographs"):
                stack = photographs.read_stack(options.frames)
                signal, truth = stack.frames, stack.truth
                constant_light = 0.05 if options.constant_light is None else options.constant_light
        else:
            with stages.stage("render"):
                ring = open_scene(options.scene, parse_definitions(options.define))
                signal, truth = render(ring, options.spp, options.seed)
                constant_light = ring.constant_light
        with stages.stage("events") as advance:
            schedule, rounds = _schedule(options, len(signal))
            recording = record(
                signal,
                constant_light,
                options.pixel.idealised() if options.ideal else options.pixel,
                schedule,
                rounds,
                options.seed,
                options.thresholds,
                options.led_rise_us,
                advance,
            )
            if len(recording.events) < 2:
                raise InputError(
                    f"{options.scene or options.frames}: no event comes of it; "
                    "check that the camera sees a lit object, and lower the thresholds or the constant light."
                )
        with stages.stage("write"), atomic_folder(options.out, "truth.npz") as folder:
            write_recording(folder / "events.h5", recording)
            write_truth(folder / "truth.npz", truth)
            if options.frames:
                photographs.write_scene(folder / "scene.xml", stack, constant_light)
            size = (folder / "events.h5").stat().st_size
    n_event, n_lit = len(recording.events), np.count_nonzero(signal.max(axis=0) > 0)
    rows = [
        ("events", f"{n_event:,}"),
        ("events per lit pixel", f"{n_event / max(n_lit, 1):.1f}"),
        ("file", f"{size / 2**20:.2f} MiB"),
        ("duration", f"{1e-6 * schedule.slot_us * len(schedule.order) * rounds:.2f} s"),
        *((f"{name} [s]", f"{seconds:.2f}") for name, seconds in stages.seconds.items()),
    ]
    print_table(f"{options.out / 'events.h5'}", rows)


def _schedule(options: Options, n_led: int):
    """Give the schedule, and how many rounds of it."""
    from evsdr.events.record import FLICKER_ROUNDS, FLICKER_US, flicker_order, ring_schedule

    if not options.flicker:
        given = options.order, options.slot_us, options.crossfade, options.trim
        return ring_schedule(n_led, *given), options.rounds
    order = flicker_order(options.order or range(n_led))
    slow = max(options.slot_us, FLICKER_US)
    return ring_schedule(n_led, order, slow, 1.0, options.trim), max(options.rounds, FLICKER_ROUNDS)


def _check(options: Options) -> None:
    """Refuse what does not go together."""
    if (options.scene is None) == (options.frames is None):
        raise InputError("Name either a scene file or --frames, not both.")
    for name, least in (("rounds", 1), ("spp", 1), ("seed", 0)):
        if getattr(options, name) is not None:
            check_range(f"--{name}", getattr(options, name), least)
    if options.scene and options.constant_light is not None:
        raise InputError("--constant-light goes with --frames; a scene has its own, often set by -D.")
    if options.frames and options.define:
        raise InputError("-D sets parameters of a scene file; leave it out with --frames.")
    check_folder(options.out)
