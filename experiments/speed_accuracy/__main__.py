"""`python -m experiments.speed_accuracy`: errors against seconds and memory, over presets, sizes, rounds, priors, threads."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from .compute import WAYS, Result, measure, slopes
from .draw import draw

BEFORE = 2.0  # seconds that pass before a fit is planned: Python, Mitsuba, reading; measured on 2 quiet cores
HEAD = "| way | size | rounds | threads | events | seconds | MiB | mean angle [deg] | SAM [deg] | RMSE | stopped |"


def main(argv: list[str] | None = None) -> None:
    """Fit, print a table in Markdown and what a preset costs, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="blob", help="name of a scene of scenes/")
    parser.add_argument(
        "--sizes", type=int, nargs="+", default=[32, 64, 128, 256], help="pixels along a side"
    )
    parser.add_argument("--rounds", type=int, nargs="+", default=[1, 6, 24], help="of the ring")
    parser.add_argument("--threads", type=int, nargs="+", default=[0], help="of a fit; 0 for all cores")
    parser.add_argument("--ways", nargs="+", choices=[way.name for way in WAYS], help="by default all")
    parser.add_argument("--figure", type=Path, help="PNG to draw")
    parser.add_argument("--json", type=Path, help="write all figures")
    options = parser.parse_args(argv)
    print(HEAD, "|---" * HEAD.count(" | ") + "|---|", sep="\n", flush=True)
    results = []
    for result in measure(options.scene, options.sizes, options.rounds, options.threads, options.ways):
        results.append(result)
        errors = result.errors
        cells = (
            result.way,
            f"{result.size}",
            f"{result.rounds}",
            f"{result.threads or 'all'}",
            f"{result.events:,}",
            f"{result.seconds:.1f}",
            f"{result.memory:.0f}",
            f"{errors['mae_deg']:.3f}",
            f"{errors['sam_deg']:.2f}",
            f"{errors['rmse']:.4f}",
            "yes" if result.stopped else "",
        )
        print(f"| {' | '.join(cells)} |", flush=True)
    print(f"\nFor evsdr/fitting/budget.py:\n\n{costs(results)}")
    if options.figure:
        draw(options.figure, results)
    if options.json:
        options.json.write_text(json.dumps([asdict(result) for result in results], indent=1))


def costs(results: list[Result]) -> str:
    """Write what a budget of time goes by, as Python; presets with fewer than three fits are left out."""
    lines = [f"REFERENCE = {min(result.task for result in results):.3g}", "COST = {"]
    for preset, (start, pixel, event) in reversed(slopes(results).items()):
        lines.append(f'    "{preset}": Cost({max(start - BEFORE, 0):.2g}, {pixel:.2g}, {event:.2g}),')
    return "\n".join([*lines, "}"])


if __name__ == "__main__":
    main()
