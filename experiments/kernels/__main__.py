"""`python -m experiments.kernels`: kernels that fits compile, and seconds, in a new home folder and a warm one."""

import argparse

from rich.console import Console
from rich.table import Table

from .compute import fit_in_turn


def main(argv: list[str] | None = None) -> None:
    """Fit two or more recordings of a scene at some sizes, one after the other; print kernels and seconds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="sphere", help="name of a scene of scenes/")
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 128, 256], help="pixels along a side")
    parser.add_argument("--fits", type=int, default=2, help="recordings of each size")
    options = parser.parse_args(argv)
    out = Table("size", *(f"fit {k + 1}" for k in range(options.fits)), title=options.scene)
    for size in options.sizes:
        fits = fit_in_turn(options.scene, size, options.fits)
        out.add_row(f"{size} x {size}", *(f"{fit.kernels} kernels, {fit.seconds:.1f} s" for fit in fits))
    Console().print(out)


if __name__ == "__main__":
    main()
