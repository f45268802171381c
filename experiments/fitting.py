"""Benchmark of whole fits: seconds, memory and errors of the presets, and of both solvers side by side."""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from evsdr.threads import limited

SCENES = Path(__file__).resolve().parent.parent / "scenes"


def report_presets(scene: str = "blob", size: int = 256, threshold: float = 0.17) -> None:
    """Fit one recording of 6 rounds with each preset.

    Parameters
    ----------
    scene : str
        Name of a scene of `scenes/`.
    size : int
        Width and height [pixels].
    threshold : float
        Contrast threshold of both polarities; 0.17 makes about 7 million events of the blob at 256 x 256.
    """
    _compare(
        scene,
        size,
        ["--pixel.contrast-threshold-on", str(threshold), "--pixel.contrast-threshold-off", str(threshold)],
        {preset: ["--preset", preset] for preset in ("fast", "balanced", "accurate")},
    )


def report_solvers(scene: str = "sphere", size: int = 64) -> None:
    """Fit one recording by Levenberg-Marquardt and by the published decoder.

    Parameters
    ----------
    scene : str
        Name of a scene of `scenes/`.
    size : int
        Width and height [pixels].
    """
    _compare(scene, size, [], {"lm": [], "adam (1600 steps)": ["--solver", "adam"]})


def _compare(scene: str, size: int, sensor: list[str], ways: dict[str, list[str]]) -> None:
    """Simulate once with 10 % threshold noise, fit in each way, print the table and the ratios."""
    file, define = str(SCENES / f"{scene}.xml"), ["-D", f"size={size}"]
    with tempfile.TemporaryDirectory() as folder:
        noisy = ["--ideal", "--pixel.event-noise", "0.1", *sensor]
        run("evsdr.simulate", [file, "--out", folder, *define, *noisy])
        table = Table(
            "", "seconds", "of these solving", "ratio", "MiB", "mean angle [deg]", "RMSE", "SAM [deg]"
        )
        first = None
        for name, options in ways.items():
            out = f"{folder}/{name}"
            truth = ["--truth", f"{folder}/truth.npz"]
            seconds, memory = run(
                "evsdr.fit", [file, f"{folder}/events.h5", "--out", out, *truth, *define, *options]
            )
            summary = json.loads(Path(out, "summary.json").read_text())
            first = first or seconds
            table.add_row(
                name,
                f"{seconds:.1f}",
                f"{summary['seconds']['solve']:.1f}",
                f"{seconds / first:.2f}",
                f"{memory:.0f}",
                *(f"{summary[key]:.3f}" for key in ("mae_deg", "rmse", "sam_deg")),
            )
        table.title = f"{scene}, {size} x {size}, {summary['numbers']['events']:,} events on the object"
    Console().print(table)


def run(module: str, arguments: list[str], home: str | None = None, threads: int = 0) -> tuple[float, float]:
    """Run a command as a process of its own, in another home folder and with so many threads if they are given.

    Returns
    -------
    seconds : float
        Wall time.
    memory : float
        At its peak [MiB].
    """
    env = os.environ | ({} if home is None else {"HOME": home}) | (limited(threads) if threads else {})
    start = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", module, *arguments], stdout=subprocess.DEVNULL, env=env)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if status:
        raise RuntimeError(f"{module} ended with status {process.returncode}")
    per_mib = 2**20 if sys.platform == "darwin" else 2**10
    return time.perf_counter() - start, usage.ru_maxrss / per_mib
