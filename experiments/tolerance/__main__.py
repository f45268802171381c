"""`python -m experiments.tolerance`: errors and CPU seconds of fits that end earlier or later."""

import argparse

import numpy as np
from rich.console import Console
from rich.table import Table

from .compute import Result, run


def main(argv: list[str] | None = None) -> None:
    """Fit recordings of a scene to each tolerance; print errors, steps and seconds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="sphere", help="name of a scene of scenes/")
    parser.add_argument("--size", type=int, default=64, help="pixels along a side")
    parser.add_argument("--seeds", type=int, default=5, help="recordings")
    options = parser.parse_args(argv)
    found = run(options.scene, options.size, range(600, 600 + options.seeds))
    Console().print(table(f"{options.scene}, {options.size} x {options.size}", found))


def table(title: str, found: dict[float, list[Result]]) -> Table:
    """Lay out means over the recordings, and how their angles scatter."""
    out = Table("tolerance", "mean angle [deg]", "scatter", "RMSE", "steps", "settled", "CPU s", title=title)
    for tolerance, results in found.items():
        angle, rmse, steps, seconds = np.array([[r.mae_deg, r.rmse, r.n_step, r.seconds] for r in results]).T
        settled = sum(r.result == "settled" for r in results)
        out.add_row(
            f"{tolerance:g}",
            f"{angle.mean():.3f}",
            f"{angle.std(ddof=1) if len(angle) > 1 else 0:.3f}",
            f"{rmse.mean():.4f}",
            f"{steps.mean():.0f}",
            f"{settled} of {len(results)}",
            f"{seconds.mean():.2f}",
        )
    return out


if __name__ == "__main__":
    main()
