"""`python -m experiments.shared`: what it costs that a rig is told wrong, and what inferring it with the maps saves."""

import argparse

import numpy as np
from rich.console import Console
from rich.table import Table

from .compute import CASES, NAMES, Result, run

UNITS = {"tau": ("{:.3g}", 1), "shift": ("{:.3g}", 1), "refractory": ("{:.3g}", 1), "noise": ("{:.4f}", 1)}
UNITS |= {
    "leak": ("{:.3f}", 1),
    "C_on": ("{:.3f}", 1),
    "C_off": ("{:.3f}", 1),
    "powers": ("{:.2g} %", 100),
    "directions": ("{:.2g}", 1),
}


def main(argv: list[str] | None = None) -> None:
    """Fit all cases in four ways; print errors, and what was found against what is true."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="sphere", help="name of a scene of scenes/ that has ring24.xml")
    parser.add_argument("--size", type=int, default=48, help="pixels along a side")
    parser.add_argument("--seeds", type=int, default=3, help="recordings of each case")
    parser.add_argument("--case", default="", help="only the cases whose names hold this")
    parser.add_argument("--pixels", action="store_true", help="event pixels of other hands' physics instead")
    options = parser.parse_args(argv)
    if options.pixels:
        from .pixels import report  # late: what it takes from evsdr wants Mitsuba started

        report(options.case, options.size, options.seeds)
        return
    found = {}
    for case in CASES:
        if options.case in case.name:
            seeds = range(900, 900 + options.seeds)
            found[case.name] = [run(case, options.scene, options.size, seed) for seed in seeds]
            Console(stderr=True).print(f"{case.name}: done")
    console = Console(width=None if Console().is_terminal else 240)
    console.print(error_table(found), values_table(found))


def error_table(found: dict[str, list[Result]]) -> Table:
    """Lay out means over the recordings of errors, sigmas and seconds."""
    ways = "none", "default", "told", "one_value"
    names = "as told", "inferred", "true", "true, C one value"
    against = (
        "inferred / true",
        "inferred / true, C one value",
        "known pixels: inferred, true, C one value",
        "up to a linear map",
    )
    inside = "% within 1 2 3 sigma: normals", "R"
    title = "Mean angle in degrees, and RMSE of reflectance"
    out = Table("", *names, *against, *inside, "CPU s: as told", "inferred", "inference", title=title)

    def mean(results: list[Result], way: str, name: str):
        return np.mean([getattr(getattr(result, way), name) for result in results], axis=0)

    for name, results in found.items():
        cells = [f"{mean(results, way, 'mae_deg'):.3f} {mean(results, way, 'rmse'):.4f}" for way in ways]
        ratios = [
            [mean(results, "default", key) / mean(results, way, key) for key in ("mae_deg", "rmse")]
            for way in ("told", "one_value")
        ]
        known, mapped = (
            " ".join(f"{mean(results, way, key):.3f}" for way in ("default", "told", "one_value"))
            for key in ("known_deg", "mapped_deg")
        )
        within = [mean(results, "default", key) for key in ("within", "reflectance_within")]
        out.add_row(
            name,
            *cells,
            *(" ".join(f"{ratio:.2f}" for ratio in pair) for pair in ratios),
            known,
            mapped,
            *(" ".join(f"{100 * share:.0f}" for share in shares) for shares in within),
            *(f"{mean(results, way, 'seconds'):.1f}" for way in ("none", "default")),
            f"{100 * mean(results, 'default', 'share'):.0f} %",
        )
    return out


def values_table(found: dict[str, list[Result]]) -> Table:
    """Lay out what was inferred and what is true, with the mean difference in units of sigma."""
    out = Table("", *NAMES, "steps", title="Inferred | true (difference in sigmas)")
    for name, results in found.items():
        cells = [value_cell(quantity, results) for quantity in NAMES]
        out.add_row(name, *cells, f"{np.mean([result.n_step for result in results]):.0f}")
    return out


def value_cell(quantity: str, results: list[Result]) -> str:
    """Write mean value, truth and difference of a quantity; empty where it was not inferred."""
    values = [result.found[quantity] for result in results if quantity in result.found]
    if not values:
        return ""
    text, factor = UNITS[quantity]
    value, true, z = np.mean(values, axis=0)
    return f"{text.format(factor * value)} | {text.format(factor * true)} ({z:+.1f})"


if __name__ == "__main__":
    main()
