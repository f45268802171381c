"""Fit recordings of many sizes in many ways, each fit a process of its own."""

import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from evsdr.fitting.budget import task_seconds
from experiments.fitting import SCENES, run

PRESETS = "fast", "balanced", "accurate"
SIMPLE = ("--shadows", "off", "--light-paths", "direct", "--leds", "far", "--gloss", "off")


@dataclass(frozen=True)
class Way:
    """A way to fit.

    Attributes
    ----------
    name : str
    options : tuple of str
        Of `python -m evsdr.fit`.
    most_pixels : int, optional
        Along a side; beyond it the way is left out.
    """

    name: str
    options: tuple[str, ...]
    most_pixels: int = 10**6


WAYS = (
    *(Way(preset, ("--preset", preset)) for preset in PRESETS),
    *(Way(f"tolerance {value:g}", ("--tolerance", f"{value:g}"), 128) for value in (3.0, 0.3, 0.01)),
    Way("no priors", ("--priors", "none"), 128),
    Way("nothing shared", ("--shared", "none"), 128),
    Way("light as told", SIMPLE, 128),
    *(Way(f"budget {seconds} s", ("--time-budget", str(seconds)), 256) for seconds in (2, 5, 20, 60)),
    Way("published decoder", ("--solver", "adam"), 128),
)


@dataclass(frozen=True)
class Result:
    """One fit: seconds all in all, memory at its peak [MiB], errors, and what the machine's own task took meanwhile [s]."""

    way: str
    size: int
    rounds: int
    threads: int
    pixels: int
    events: int
    seconds: float
    memory: float
    task: float
    errors: dict = field(default_factory=dict)
    stopped: bool = False


def measure(
    scene: str, sizes: list[int], rounds: list[int], threads: list[int], ways: list[str] | None
) -> Iterator[Result]:
    """Fit recordings of an EVK4 that tells one value for all thresholds.

    Parameters
    ----------
    scene : str
        Name of a scene of `scenes/`.
    sizes : list of int
        Pixels along a side.
    rounds : list of int
        Of the ring.
    threads : list of int
        Of a fit; 0 for all cores.
    ways : list of str, optional
        Names of `WAYS`; by default all.
    """
    file = str(SCENES / f"{scene}.xml")
    chosen = [way for way in WAYS if ways is None or way.name in ways]
    with tempfile.TemporaryDirectory() as folder:
        for size in sizes:
            define = ["-D", f"size={size}"]
            for n_round in rounds:
                told = ["--thresholds", "nominal", "--rounds", str(n_round)]
                run("evsdr.simulate", [file, "--out", folder, *define, *told])
                for n_thread in threads:
                    for way in chosen:
                        if size <= way.most_pixels:
                            yield _fit(way, Path(folder), file, define, size, n_round, n_thread)


def _fit(
    way: Way, folder: Path, file: str, define: list[str], size: int, rounds: int, threads: int
) -> Result:
    words = [file, f"{folder}/events.h5", "--out", f"{folder}/fit", "--truth", f"{folder}/truth.npz", *define]
    run("evsdr.fit", [*words, *way.options], threads=threads)  # compiles
    seconds, memory = run("evsdr.fit", [*words, *way.options], threads=threads)
    summary = json.loads((folder / "fit" / "summary.json").read_text())
    numbers = summary["numbers"]["pixels_solved"], summary["numbers"]["events"]
    task = min(task_seconds() for _ in range(3))
    errors = {name: summary[name] for name in ("mae_deg", "sam_deg", "rmse")}
    return Result(
        way.name, size, rounds, threads, *numbers, seconds, memory, task, errors, summary["stopped"]
    )


def slopes(results: list[Result]) -> dict[str, tuple[float, float, float]]:
    """Give seconds of each preset: of any fit, of a pixel, of an event; least squares of relative errors, none below 0."""
    from scipy.optimize import nnls

    found = {}
    for preset in PRESETS:
        of = [r for r in results if r.way == preset and r.threads == 0]
        if len(of) >= 3:
            terms = np.array([[1.0, r.pixels, r.events] for r in of]) / np.array([[r.seconds] for r in of])
            found[preset] = tuple(nnls(terms, np.ones(len(of)))[0].tolist())
    return found
