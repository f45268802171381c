"""`python -m experiments.ablation`: what each mechanism of the solver buys, on six kinds of recordings."""

import argparse

import numpy as np
from rich.console import Console
from rich.table import Table

from .compute import CASES, WAYS, Result, run, varied

SCATTER = 5  # recordings that tell how errors scatter


def main(argv: list[str] | None = None) -> None:
    """Fit all cases in all ways; print errors relative to those of all mechanisms together."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2, help="recordings of each case")
    parser.add_argument("--case", help="only the cases whose names hold this")
    parser.add_argument(
        "--numbers", action="store_true", help="halve and double the solver's numbers instead"
    )
    options = parser.parse_args(argv)
    ways, first = (varied(), 200) if options.numbers else (WAYS, 100)  # on recordings of their own
    cases = [case for case in CASES if (options.case or "") in case.name]
    found = {}
    for case in cases:
        for way, seed, result in run(case, range(first, first + options.seeds), ways):
            found.setdefault((way, case.name), []).append(result)
        more = range(first + options.seeds, first + SCATTER)
        scattered = [result for _, _, result in run(case, more, {"all": ways["all"]})]
        found["scatter", case.name] = found["all", case.name] + scattered
        Console(stderr=True).print(f"{case.name}: done")
    for title, attribute in (("mean angle", "mae_deg"), ("RMSE", "rmse"), ("seconds", "seconds")):
        Console().print(table(title, attribute, ways, [case.name for case in cases], found))


def table(
    title: str, attribute: str, ways, names: list[str], found: dict[tuple[str, str], list[Result]]
) -> Table:
    """Lay out one figure: of all mechanisms together, its scatter, and ratios to it in each way."""
    out = Table("left out, or changed", *names, title=f"{title}, relative to all mechanisms together")

    def values(way, name):
        return np.array([getattr(result, attribute) for result in found[way, name]])

    out.add_row("nothing", *(f"{values('all', name).mean():.4g}" for name in names))
    scatter = [np.std(values("scatter", name), ddof=1) / values("scatter", name).mean() for name in names]
    out.add_row("scatter over recordings", *(f"{100 * s:.1f} %" for s in scatter))
    for way in ways:
        if way != "all":
            ratios = [np.mean(values(way, name) / values("all", name)) for name in names]
            out.add_row(way, *(f"{ratio:.3f}" for ratio in ratios))
    return out


if __name__ == "__main__":
    main()
