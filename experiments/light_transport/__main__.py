"""`python -m experiments.light_transport`: what each modelled effect of light transport buys and costs."""

import argparse

from rich.console import Console
from rich.table import Table

from .compute import CASES, REPOSITORY, run

OUT = REPOSITORY / "out" / "light_transport"


def main() -> None:
    """Record and fit all cases; print a table and what `auto` decided, write a picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=64, help="width and height [pixels]")
    parser.add_argument("--effect", help="of this effect only")
    options = parser.parse_args()
    size = options.size
    from .draw import draw

    table = Table(box=None, padding=(0, 1, 0, 0))
    for heading in ("effect", "scene", "way", "mean angle", "RMSE", "seconds"):
        table.add_column(heading, no_wrap=True)
    found, notes = [], []
    for i, case in enumerate(CASES):
        if options.effect not in (None, case.effect):
            continue
        results = run(case, OUT / f"{i}_{case.scene}", size)
        scene = " ".join((case.scene, *(f"{name}={value}" for name, value in case.define.items())))
        for r in results:
            table.add_row(case.effect, scene, r.way, f"{r.mae_deg:.2f}", f"{r.rmse:.4f}", f"{r.seconds:.1f}")
        found.append((f"{case.effect}\n{scene}", results))
        notes.append(f"{scene}: {results[-1].decision}")
    Console().print(table)
    print("\n".join(notes))
    draw(found, OUT / "light_transport.png")
    print(f"picture: {OUT / 'light_transport.png'}")


if __name__ == "__main__":
    main()
