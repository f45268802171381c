"""`python -m experiments.batch`: many fits on each engine, two of whose workers are killed, beside a clean run."""

import argparse

from rich.console import Console
from rich.table import Table

from .compute import ENGINES, run


def main(argv: list[str] | None = None) -> None:
    """Fit the same recordings on each engine; print how many tries it took, and how many maps differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fits", type=int, default=12, help="recordings")
    parser.add_argument("--size", type=int, default=8, help="pixels along a side")
    parser.add_argument("--engines", nargs="+", default=list(ENGINES), choices=ENGINES)
    options = parser.parse_args(argv)
    out = Table("engine", "done", "tries", "maps that differ from a clean run", "seconds")
    for name, result in run(options.fits, options.size, options.engines):
        out.add_row(
            name,
            f"{result.done} of {options.fits}",
            f"{result.tries}",
            f"{result.differ}",
            f"{result.seconds:.0f}",
        )
    Console().print(out)


if __name__ == "__main__":
    main()
