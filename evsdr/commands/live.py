"""`python -m evsdr.live FILE scene.xml`: play a recording back, and turn its last round into normals many times a second."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from evsdr.commands.console import print_table, run_command
from evsdr.errors import InputError, parse_definitions


@dataclass(frozen=True, kw_only=True)
class Options:
    """Play a recording back, and turn its last round into normals many times a second."""

    events: tyro.conf.Positional[Path]
    """Recording, an events.h5."""
    scene: tyro.conf.Positional[Path]
    """Scene file: camera, LEDs, object."""
    out: Path | None = None
    """Picture of the normals, a PNG that each map replaces; by default live.png with the name of the recording before it,
    beside it."""
    truth: Path | None = None
    """truth.npz to compare with; preset fast is fitted to the whole recording, and compared, too."""
    rounds: float = 1.0
    """Last rounds that count."""
    maps_hz: float = 10.0
    """Maps for each second of the recording."""
    realtime: bool = False
    """Play at the recording's own speed, and leave out maps that would be late; else as fast as it goes."""
    define: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-D"]), tyro.conf.UseAppendAction] = field(
        default=()
    )
    """name=value for a <default> parameter of the scene file; may be repeated."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("live", Options, play, argv)


def play(options: Options) -> None:
    """Play, write the picture, print how fast and how good the maps were."""
    out = check(options)
    from evsdr.files.events_h5 import read_recording
    from evsdr.files.truth import read_truth
    from evsdr.fitting.entrance import load_scene
    from evsdr.preview.play import error_rows, fast_rows, play_all, prepare, speed_rows
    from evsdr.progress import Stages

    names = ("read recording", "load scene", "play", *(("fit fast",) if options.truth else ()))
    with Stages("live", names) as stages:
        with stages.stage("read recording"):
            recording = read_recording(options.events)
        with stages.stage("load scene"):
            scene = load_scene(options.scene, **parse_definitions(options.define))
            truth = options.truth and read_truth(options.truth, scene.height, scene.width, scene.leds.n_band)
            played, light = prepare(scene, recording)
        with stages.stage("play") as told:
            asked = options.rounds, options.maps_hz, options.realtime
            frames = play_all(played, light, *asked, out, told)
        rows = speed_rows(frames)
        if truth:
            rows += error_rows(frames[-1], truth)
            with stages.stage("fit fast"):
                rows += fast_rows(scene, recording, truth)
    print_table(f"{options.events} {options.scene}", rows)
    print(f"picture of the last map: {out}")


def check(options: Options) -> Path:
    """Check the options; gives where the picture goes."""
    for name in ("rounds", "maps_hz"):
        value = getattr(options, name)
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"--{name.replace('_', '-')} is {value:g}; give a number above 0.")
    out = options.out or options.events.with_name(f"{options.events.stem}.live.png")
    if out.resolve() in {path.resolve() for path in (options.events, options.scene, options.truth) if path}:
        raise InputError(f"{out}: this is one of the files to read; give another one by --out.")
    if not out.parent.is_dir():
        raise InputError(f"{out}: there is no folder {out.parent}; make it, or give another one by --out.")
    return out
