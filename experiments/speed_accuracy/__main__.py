"""`python -m experiments.speed_accuracy`: errors against seconds and memory, over presets, sizes, rounds, priors, threads."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from .compute import WAYS, measure, slopes
from .draw import draw

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
    print(f"\nThe machine's own task took {min(result.task for result in results):.3f} s (`REFERENCE`).")
    for preset, (start, pixel, event) in slopes(results).items():
        print(f"{preset}: Cost({start:.2g}, {pixel:.2g}, {event:.2g})  # seconds of a fit, a pixel, an event")
    if options.figure:
        draw(options.figure, results)
    if options.json:
        options.json.write_text(json.dumps([asdict(result) for result in results], indent=1))


if __name__ == "__main__":
    main()
