"""`python -m experiments.sigma`: whether sigmas are true, over scenes and cameras."""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from .cases import chosen
from .compute import Row, run
from .statistics import keeps_promise, level_of_each

OUT = Path(__file__).resolve().parents[2] / "out" / "sigma"
FIRST_SEED = 700
COLUMNS = {
    "scene/camera": 20,
    "known %": 7,
    "deg: mean, median": 17,
    "RMSE": 6,
    "normals: % within 1 2 3": 23,
    "z^2": 6,
    "> 5": 4,
    "p": 8,
    "R: % within 1 2 3": 17,
    "z^2 ": 6,
    "p ": 8,
    "promise": 7,
    "s": 4,
}


def main(argv: list[str] | None = None) -> int:
    """Run all cases, print a line of the table of each as it comes, write figures and picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="recordings of each case")
    parser.add_argument("--cases", default="", help="as sphere/evk4,chart,foreign; all by default")
    parser.add_argument("--size", type=int, default=32, help="width and height [pixels]")
    parser.add_argument("--out", type=Path, default=OUT, help="folder for sigma.json and sigma.png")
    parser.add_argument(
        "--shared", action="store_true", help="draw what all pixels share from what is told of it, instead"
    )
    options = parser.parse_args(argv)
    seeds = range(FIRST_SEED, FIRST_SEED + options.seeds)
    if options.shared:
        from .shared import report

        return report(seeds, options.size)
    try:
        cases = chosen(options.cases)
    except ValueError as error:
        parser.error(str(error))
    print(line(COLUMNS), line("-" * width for width in COLUMNS.values()), sep="\n")
    rows = []
    for case in cases:
        rows.append(run(case, options.size, seeds))
        print(line(cells(rows[-1])), flush=True)
    print("\n" + conclusion(rows))
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "sigma.json").write_text(json.dumps([figures(row) for row in rows], indent=1) + "\n")
    from .draw import draw

    draw(rows, options.out / "sigma.png")
    print(f"figures and picture: {options.out}")
    return 0


def line(values) -> str:
    """Lay out a line of a Markdown table."""
    return "| " + " | ".join(value.ljust(width) for value, width in zip(values, COLUMNS.values())) + " |"


def cells(row: Row) -> list[str]:
    """Give the figures of a case, in the order of `COLUMNS`."""
    kept = ["yes" if keeps_promise(row.within(name)) else "no" for name in ("angle", "reflectance")]
    return [
        row.name,
        f"{100 * row.mean('known'):.0f}",
        f"{row.mean('mean_deg'):.3f} {row.mean('median_deg'):.3f}",
        f"{row.mean('rmse'):.4f}",
        percent(row.within("angle")),
        f"{row.mean_square('angle'):.1f}",
        f"{row.beyond()}",
        f"{row.test('angle').p:.1g}",
        percent(row.within("reflectance")),
        f"{row.mean_square('reflectance'):.1f}",
        f"{row.test('reflectance').p:.1g}",
        " ".join(kept),
        f"{row.mean('seconds'):.1f}",
    ]


def percent(shares: np.ndarray) -> str:
    return " ".join(f"{100 * share:.0f}" for share in shares)


def conclusion(rows: list[Row]) -> str:
    """Say in how many cases sigmas are as promised, and true."""
    level = level_of_each(2 * len(rows))
    kept, true = (
        {name: sum(test(row, name) for row in rows) for name in ("angle", "reflectance")}
        for test in (
            lambda row, name: keeps_promise(row.within(name)),
            lambda row, name: row.test(name).p > level,
        )
    )
    return (
        f"of {len(rows)} cases the promise (60, 90, 97 %) holds in {kept['angle']} (normals) and "
        f"{kept['reflectance']} (reflectance), and chi-square with Sidak's correction (p > {level:.1g}) refuses not "
        f"{true['angle']} and {true['reflectance']}"
    )


def figures(row: Row) -> dict:
    """Give the figures of a case for a file; shares within one sigma for each band, too."""
    out = {name: row.mean(name) for name in ("known", "mean_deg", "median_deg", "rmse", "seconds")}
    for name in ("angle", "reflectance"):
        verdict = row.test(name)
        out |= {
            f"{name}_within": row.within(name).tolist(),
            f"{name}_mean_square": row.mean_square(name),
            f"{name}_p": verdict.p,
            f"{name}_effect": verdict.effect,
        }
    bands = np.abs(row.z("reflectance"))
    return {
        "case": row.name,
        **out,
        "beyond_5_sigma": row.beyond(),
        "bands_within_1_sigma": np.mean(bands <= 1, axis=0).tolist() if len(bands) else [],
        "verdicts": [error.verdict for error in row.errors],
    }


if __name__ == "__main__":
    sys.exit(main())
