"""Seconds of each stage beside those of a fixed task of NumPy: one file a release, so that releases compare on any machine."""

import json
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import evsdr
from evsdr.rig.reader import read_camera_file
from experiments.fitting import SCENES, run

RELEASES = Path(__file__).resolve().parent / "releases"
REPEATS = 3  # of which the quickest counts: what else runs only adds
RAW_HEADER = b"% evt 3.0\n% format EVT3;height=720;width=1280\n% geometry 1280x720\n% end\n"


@dataclass(frozen=True)
class Stage:
    """What a stage took.

    Attributes
    ----------
    name : str
    events : int
        That it went through.
    cpu, wall : float
        Seconds of all threads, and on the clock.
    ratio : float
        CPU seconds in those of the task of NumPy.
    memory : float
        Peak of a fit, a process of its own [MiB]; else 0.
    error : float
        Mean angle of a fit [deg]; else 0.
    """

    name: str
    events: int
    cpu: float
    wall: float
    ratio: float
    memory: float = 0.0
    error: float = 0.0


def report(out: Path | None = None, size: int = 64, events: int = 4_000_000) -> None:
    """Measure simulating, reading, writing and fitting; compare with the release before, if there is one.

    Parameters
    ----------
    out : Path, optional
        JSON to write; by default one named after this release, in `experiments/releases`.
    size : int
        Pixels along a side, of what is simulated and fitted.
    events : int
        Of the files that are read.
    """
    out = out or RELEASES / f"{evsdr.__version__}.json"
    task, stages = timed(numpy_task)[0], []
    before = before_it(out)
    table = Table("", "events", "CPU s", "wall s", "M/CPU s", "tasks", "MiB", "mean angle [deg]", "before")
    for stage in measure(size, events, task):
        stages.append(stage)
        old = before.get(stage.name)
        table.add_row(
            stage.name,
            f"{stage.events:,}",
            f"{stage.cpu:.3g}",
            f"{stage.wall:.3g}",
            f"{1e-6 * stage.events / stage.cpu:.3g}",
            f"{stage.ratio:.3g}",
            f"{stage.memory:.0f}" if stage.memory else "",
            f"{stage.error:.3f}" if stage.error else "",
            f"{stage.ratio / old:.2f} x" if old else "",
        )
    table.title = f"evsdr {evsdr.__version__}; a task of NumPy takes {task:.3f} s"
    Console(width=120).print(table)
    machine = {"cores": os.cpu_count(), "processor": platform.machine(), "numpy": np.__version__}
    told = {"version": evsdr.__version__, "size": size, "task_seconds": task, "machine": machine}
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(
        json.dumps(told | {"stages": [asdict(stage) for stage in stages]}, indent=1) + "\n", "utf-8"
    )


def before_it(out: Path) -> dict[str, float]:
    """Give the ratios of the release before, by the names of stages."""
    others = sorted((path for path in out.parent.glob("*.json") if path != out), key=_version)
    told = json.loads(others[-1].read_text("utf-8")) if others else {"stages": []}
    return {stage["name"]: stage["ratio"] for stage in told["stages"]}


def _version(path: Path) -> tuple:
    return tuple(int(part) if part.isdecimal() else 0 for part in path.stem.split("."))


def numpy_task() -> None:
    """Draw, take logarithms, sort and multiply matrices: what a fit does, too."""
    rng = np.random.default_rng(0)
    np.sort(np.log1p(rng.random(2_000_000)))
    matrix = rng.random((400, 400))
    for _ in range(10):
        matrix = np.tanh(matrix @ matrix)


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Give CPU and wall seconds of the quickest of some runs, after one that compiles."""
    work()
    seconds = []
    for _ in range(REPEATS):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        seconds.append((time.process_time() - cpu, time.perf_counter() - wall))
    return min(seconds)


def measure(size: int, n_event: int, task: float) -> Iterator[Stage]:
    """Time stage after stage."""

    def of(name: str, events: int, work: Callable[[], object]) -> Stage:
        cpu, wall = timed(work)
        return Stage(name, events, cpu, wall, cpu / task)

    scene = evsdr.load_scene(SCENES / "blob.xml", size=size)
    ideal, recording = evsdr.EventPixel.ideal(), None
    for name, pixel in (("ideal pixels", ideal), ("an EVK4", evsdr.EventPixel())):
        recording, _ = evsdr.simulate(scene, pixel)
        yield of(f"simulate {name}", len(recording.events), lambda pixel=pixel: evsdr.simulate(scene, pixel))
    with tempfile.TemporaryDirectory() as folder:
        path, raw = Path(folder) / "events.h5", Path(folder) / "events.raw"
        many = repeated(recording, n_event)
        yield of("write events.h5", n_event, lambda: evsdr.write_recording(path, many))
        yield of("read events.h5", n_event, lambda: evsdr.read_recording(path))
        raw.write_bytes(RAW_HEADER + raw_words(n_event).tobytes())
        yield of("read RAW", n_event, lambda: read_camera_file(raw))
        yield from fits(Path(folder), size, task)


def repeated(recording: evsdr.Recording, n_event: int) -> evsdr.Recording:
    """Let a recording go on until it has so many events."""
    events, k = recording.events, np.arange(n_event)
    again, k = np.divmod(k, len(events))
    later = again * (int(events.t[-1]) + 1)
    many = evsdr.Events(events.x[k], events.y[k], events.p[k], events.t[k] + later)
    return evsdr.Recording(many, recording.sensor, recording.schedule, recording.round_start_us[:0])


def raw_words(n_event: int) -> np.ndarray:
    """Make words of EVT 3.0 whose kinds are mixed as in a recording of moving things: a row and a time for nearly each event."""
    rng, t = np.random.default_rng(0), np.arange(n_event)
    words = np.zeros((n_event, 4), np.uint16)
    words[:, 0] = np.where(t % 8 == 0, 0x8000 | (t >> 12 & 0xFFF), 0xE000)  # time high, or what is left out
    words[:, 1] = 0x6000 | (t & 0xFFF)
    words[:, 2] = rng.integers(0, 720, n_event)
    words[:, 3] = 0x2000 | rng.integers(0, 1280, n_event) | rng.integers(0, 2, n_event) << 11
    kept = np.ones(words.shape, bool)
    kept[:, 0] = t % 8 == 0
    kept[:, 1] = (t % 8 == 0) | (rng.random(n_event) < 0.85)
    return words[kept]


def fits(folder: Path, size: int, task: float) -> Iterator[Stage]:
    """Simulate an EVK4 that tells one value for all thresholds, and fit that by each preset, each a process of its own."""
    words = [str(SCENES / "blob.xml"), "-D", f"size={size}"]
    run("evsdr.simulate", [*words, "--out", str(folder), "--thresholds", "nominal"])
    for preset in ("fast", "balanced"):
        given = [*words, str(folder / "events.h5"), "--truth", str(folder / "truth.npz"), "--preset", preset]
        took = []
        for _ in range(2):  # the first compiles
            before = os.times()
            wall, memory = run("evsdr.fit", [*given, "--out", str(folder / preset)])
            after = os.times()
            took.append((sum(after[2:4]) - sum(before[2:4]), wall, memory))
        cpu, wall, memory = took[-1]
        summary = json.loads((folder / preset / "summary.json").read_text("utf-8"))
        n_event, error = summary["numbers"]["events"], summary["mae_deg"]
        yield Stage(f"fit, {preset}", n_event, cpu, wall, cpu / task, memory, error)
