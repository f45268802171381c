"""`python -m evsdr.fit scene.xml events.h5`: recover normals and absolute reflectance from a recording."""

import shlex
import sys
import time
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from evsdr.commands.console import print_table, run_command, stopped_by
from evsdr.errors import check_range, parse_definitions
from evsdr.files.atomic import check_folder
from evsdr.files.events_h5 import read_recording
from evsdr.files.truth import read_truth
from evsdr.fitting.budget import seconds_so_far
from evsdr.fitting.entrance import SOLVE, Fit, collected_warnings, fit, load_scene, start
from evsdr.fitting.settings import PRIORS, SHARED, Settings, check_names
from evsdr.fitting.timeline import FIT, plan_of
from evsdr.metrics import score
from evsdr.progress import Stages
from evsdr.signals import Patience
from evsdr.solve.tuning import Tuning

CONTRADICTED = 3  # exit status of results that contradict the files
LEAST_LEFT = 0.01  # seconds of a budget after all is read


@dataclass(frozen=True)
class Files:
    """What a fit reads and writes."""

    scene: tyro.conf.Positional[Path]
    """Scene file: camera, LEDs, object."""
    events: tyro.conf.Positional[Path]
    """Recording, an events.h5."""
    out: Path | None = None
    """Folder for the results; by default named after the recording."""
    truth: Path | None = None
    """truth.npz to compare with."""
    report: bool = True
    """Write report.html, a page that shows all of it in a browser."""


@dataclass(frozen=True)
class Options(Settings, Files):
    """Recover surface normals and absolute spectral reflectance from events under a ring of LEDs."""

    priors: str = ",".join(PRIORS)
    """What pixels tell of each other, or none: smooth normals, slopes of one surface, smooth reflectance, spectra
    of few kinds. Edges stay, and the data decide how strong each is."""
    shared: str = ",".join(SHARED)
    """What all pixels share and is unknown, with what is told as a prior, or none: powers of LEDs against the others of
    their band, lag and noise of photoreceptors, shift of all times, refractory period, a leak, thresholds, directions of
    LEDs."""
    tuning: tyro.conf.Suppress[Tuning] = Tuning()
    mask: Path | None = None
    """Image (PNG or .npy) whose non-zero pixels are solved."""
    define: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-D"]), tyro.conf.UseAppendAction] = field(
        default=()
    )
    """name=value for a <default> parameter of the scene file; may be repeated."""
    device: Literal["cpu", "gpu"] = "cpu"
    """Where to compute; gpu needs an NVIDIA card."""

    def settings(self) -> Settings:
        """Give what is asked of the fit, checked."""
        check_range("--seed", self.seed, 0)
        lists = {"priors": PRIORS, "shared": SHARED}
        named = {option: names_of(getattr(self, option), known, option) for option, known in lists.items()}
        asked = {field.name: getattr(self, field.name) for field in fields(Settings)}
        return Settings(**asked | named)


def names_of(text: str, known: tuple[str, ...], option: str) -> tuple[str, ...]:
    """Read names between commas, or none."""
    names = tuple(name.strip() for name in text.split(",")) if text != "none" else ()
    check_names(names, known, f"--{option} {text}")
    return names


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    told = shlex.join(map(str, sys.argv[1:] if argv is None else argv))
    began = time.perf_counter() - (seconds_so_far() if argv is None else 0.0)
    return run_command("fit", Options, partial(command, told=told, began=began), argv)


def command(options: Options, told: str = "", began: float | None = None) -> int:
    """Fit, write the results, print a table; gives 3 if the results contradict the files.

    `told` is what was typed, `began` when a budget of time began, by `time.perf_counter`; by default now.

    Ctrl-C, SIGTERM and SIGHUP while the solver runs end it early, with the best so far; once more, at once and with
    nothing.
    """
    out = options.out or options.events.with_name(options.events.stem)
    check_folder(out)
    with Patience() as patience:
        found = recover(options, patience, time.perf_counter() if began is None else began)
        more = {"stopped_by": patience.came.name} if patience.came and found.summary["stopped"] else {}
        found = replace(found, summary=found.summary | more | {"command": f"python -m evsdr.fit {told}"})
        found.save(out, options.report)
    if patience.came:
        best = "the best so far" if found.summary["stopped"] else "the whole fit"
        return stopped_by(patience.came, f"{best} is in {out}, see `stopped` in its summary.json.")
    summary = found.summary
    rows = [(f"{name} [s]", f"{seconds:.2f}") for name, seconds in summary["seconds"].items()]
    rows += [(name, f"{value:.4f}") for name, value in summary.get("error", {}).items()]
    rows += [("verdict", found.verdict.partition(":")[0])]
    print_table(f"{options.scene} {options.events}", rows)
    for effect, decision in summary["model"].items():
        print(f"{effect}: {decision}")
    if options.report:
        print(f"page to look at in a browser: {out / 'report.html'}")
    print(f"pictures: {out / 'normal.png'}, {out / 'reflectance.png'}; all else in {out}")
    return CONTRADICTED if found.contradicted else 0


def recover(options: Options, patience: Patience, began: float) -> Fit:
    """Read the files, fit, and compare with the truth if there is one; a stop while the solver runs ends it early."""
    from evsdr.fitting.tiling import expected  # late: help needs no numba

    settings = options.settings()
    with collected_warnings() as messages, Stages("fit", FIT) as stages:
        with stages.stage("start"):
            start(options.device)
        with stages.stage("read events"):
            recording = read_recording(options.events)
        with stages.stage("load scene"):
            scene = load_scene(options.scene, **parse_definitions(options.define))
            n_tile = expected(recording) if settings.solver == "lm" else 0
            stages.expect(plan_of(scene.shape_is_known, settings.preset == "fast", n_tile))
            truth = options.truth and read_truth(options.truth, scene.height, scene.width, scene.leds.n_band)

        def progress(stage: str, share: float) -> bool:
            if stage.startswith(SOLVE):
                patience.begin()
            stages.show("stopping; once more to end at once" if patience.came else stage, share)
            return patience.came is not None

        if settings.time_budget is not None:
            left = settings.time_budget - (time.perf_counter() - began)
            settings = replace(settings, time_budget=max(left, LEAST_LEFT))
        found = fit(scene, recording, settings, options.mask, progress)
    if options.time_budget is not None:
        found.summary["time_budget"]["seconds"] = options.time_budget
    error = score(found.maps, truth) if truth else {}
    summary = found.summary | ({"error": error} | error if error else {})
    seconds = stages.seconds | summary["seconds"]
    return replace(found, summary=summary | {"warnings": messages, "seconds": seconds}, truth=truth)
