"""`python -m evsdr.view FILE [scene.xml]`: look at a file of events before it is fitted.

It writes one page for any browser, and says in a table and plain sentences whether the recording is good.
"""

import shlex
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from evsdr.commands.console import print_table, run_command
from evsdr.errors import InputError, parse_definitions

CONTRADICTED = 3  # exit status of a recording that contradicts what is told of it

PLAIN = "read recording", "look at pixels", "look for rounds", "look for other light", "write"  # stages
WITH_SCENE = "read recording", "load scene", *PLAIN[1:-1], "fit quickly", "expected accuracy", "write"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Look at a file of events: is it good, does it go with its schedule, and with a scene?"""

    events: tyro.conf.Positional[Path]
    """Any file of events: an events.h5, or what a camera wrote."""
    scene: tyro.conf.Positional[Path | None] = None
    """Scene file: with it swapped LEDs and a mirrored image are found, pixels are shown beside their modelled light, and
    it is told how well a fit can do at best."""
    out: Path | None = None
    """Page to write; by default view.html with the name of the recording before it, beside it."""
    ring: Path | None = None
    """Log of the ring, ring.json, for a camera's file: it tells the schedule."""
    start_us: float | None = None
    """Start of the first round on the camera's clock [us], beside --ring, for a recording without triggers."""
    triggers: Path | None = None
    """File of triggers beside a camera's file, as of EventPS or DSEC."""
    sensor_size: tuple[int, int] | None = None
    """Width and height of the sensor, where the file does not tell."""
    define: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-D"]), tyro.conf.UseAppendAction] = field(
        default=()
    )
    """name=value for a <default> parameter of the scene file; may be repeated."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    given = sys.argv[1:] if argv is None else argv
    command = shlex.join(["python", "-m", "evsdr.view", *map(str, given)])
    return run_command("view", Options, lambda options: look(options, command), argv)


def look(options: Options, command: str) -> int:
    """Look, write the page, print what was found."""
    define = parse_definitions(options.define)
    out = options.out or options.events.with_name(f"{options.events.stem}.view.html")
    if out.resolve() in {path.resolve() for path in (options.events, options.scene, options.ring) if path}:
        raise InputError(f"{out}: this is one of the files to look at; give another one by --out.")
    from evsdr.files.atomic import atomic_path
    from evsdr.fitting.entrance import load_scene
    from evsdr.progress import Stages
    from evsdr.viewing.check import verdict
    from evsdr.viewing.checks import examine
    from evsdr.viewing.document import page
    from evsdr.viewing.look import look_at
    from evsdr.viewing.source import open_watched
    from evsdr.viewing.words import meaning

    names = PLAIN if options.scene is None else WITH_SCENE
    with Stages("view", names) as stages:
        with stages.stage("read recording"):
            watched = open_watched(
                options.events, options.ring, options.sensor_size, options.start_us, options.triggers
            )
        ring = None
        if options.scene is not None:
            with stages.stage("load scene"):
                ring = load_scene(options.scene, **define)
        found = look_at(watched, ring, stages)
        answers = examine(found)
        with stages.stage("write"), atomic_path(out) as temporary:
            temporary.write_text(page(found, answers, command), encoding="utf-8")
    word = verdict(answers)
    rows = [(check.name, check.state) for check in answers]
    print_table(
        str(options.events), [*rows, ("verdict", word), ("seconds", f"{sum(stages.seconds.values()):.2f}")]
    )
    for check in answers:
        print(f"{check.name}: {check}")
    print(f"{word}: {meaning(word, found)}")
    print(f"{out}: open it in a browser.")
    return CONTRADICTED if word == "contradicted" else 0
