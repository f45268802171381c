"""`python -m experiments.gloss`: compare what helps against gloss on a simulated sphere."""

import sys
from dataclasses import dataclass

import tyro
from rich.console import Console
from rich.table import Table

from . import compute


@dataclass(frozen=True)
class Options:
    """Compare what helps against gloss."""

    size: int = 64
    """Width and height of the images [pixels]."""
    seeds: int = 1
    """Recordings to average over."""


def main() -> int:
    """Simulate, fit by all methods, print one table per sphere."""
    options = tyro.cli(Options)
    for name in ("matt", "coating", "blinn-phong"):
        spheres = [compute.simulate(name, options.size, seed) for seed in range(options.seeds)]
        compute.run(spheres[0], next(iter(compute.METHODS)))  # compiles the kernels
        results = {m: [compute.run(sphere, m) for sphere in spheres] for m in compute.METHODS}
        Console(width=150).print(table(name, results))
    return 0


def table(name: str, results: dict) -> Table:
    """Lay out mean errors and seconds of each method."""
    out = Table(title=f"sphere: {name}", box=None, padding=(0, 1, 0, 0))
    for heading in ("", "mean [deg]", "median [deg]", "RMSE", "SAM [deg]", "CPU s", "found"):
        out.add_column(heading, justify="left" if heading in ("", "found") else "right")
    for method, runs in results.items():
        mean = {key: sum(r.error[key] for r in runs) / len(runs) for key in runs[0].error}
        seconds = sum(r.seconds for r in runs) / len(runs)
        values = (f"{mean[key]:.{digits}f}" for key, digits in SHOWN)
        out.add_row(method, *values, f"{seconds:.1f}", runs[0].note)
    return out


SHOWN = (("mae_deg", 2), ("median_deg", 2), ("rmse", 3), ("sam_deg", 2))

if __name__ == "__main__":
    sys.exit(main())
