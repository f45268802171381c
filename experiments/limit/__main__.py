"""`python -m experiments.limit`: how close a fit comes to the Cramer-Rao bound, and what the bound depends on."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console

from evsdr import jit

from . import summary, tables

OUT = Path(__file__).resolve().parents[2] / "out" / "limit"
SCENES = ("sphere", "blob", "relief", "colorchecker")
PRESETS = ("fast", "balanced", "accurate")
CALIBRATED = ("sphere", "blob", "relief", "near_ring", "sphere_pole")
BASE_VALUE = {"constant light": 0.05, "noise": 10, "rounds": 6}  # on the figure's axes


@dataclass(frozen=True)
class Options:
    """Compare errors with the Cramer-Rao bound over constant light, threshold, noise and rounds."""

    quick: bool = False
    """Only the base case and the calibration of sigma."""
    size: int = 64
    """Width and height of the images [pixels]; sigma is looked at in twice that, too."""
    out: Path = OUT
    """Folder for limit.json, limit.md and limit.png."""


def main(argv: list[str] | None = None) -> int:
    """Run all cases, print tables as they come, write figures and picture."""
    options = tyro.cli(Options, prog="python -m experiments.limit", args=argv)
    options.out.mkdir(parents=True, exist_ok=True)
    jit.start()
    from . import compute

    console = Console(width=120)
    rows, base, signal, calibration = [], [], {}, []
    for name in SCENES:
        rendered = compute.render(name, options.size)
        signal[name] = compute.led_signal(rendered)
        found = compute.run(rendered, compute.BASE, PRESETS)
        base += found
        console.print(tables.case_table(f"\n{name}, base case", "preset", found))
        for parameter, settings in {} if options.quick else compute.SWEEPS.items():
            balanced = [row for row in found if row["preset"] == "balanced"]
            swept = []
            for value, setting in settings:
                case = balanced if setting == compute.BASE else compute.run(rendered, setting)
                swept += [row | {"parameter": parameter, "value": value} for row in case]
            console.print(tables.case_table(f"\n{name}, {parameter}", "value", swept))
            rows += swept
    for name in CALIBRATED:
        for size in (options.size, 2 * options.size):
            calibration += compute.calibrate(compute.render(name, size))
    ratios = summary.median_ratios(base)
    result = {"base": base, "median ratio": ratios, "LED signal": signal, "calibration": calibration}
    console.print(tables.calibration_table(calibration))
    console.print(tables.ratio_table(ratios))
    if rows:
        best = summary.best_constant_light(rows, signal)
        result |= {"sweeps": rows, "best constant light": best}
        console.print(tables.best_table(best, signal))
    (options.out / "limit.json").write_text(json.dumps(result, indent=1, allow_nan=False) + "\n")
    if rows:
        (options.out / "limit.md").write_text(tables.markdown(rows))
        from .draw import draw

        draw(rows, BASE_VALUE, signal, options.out / "limit.png")
        print(f"picture: {options.out / 'limit.png'}")
    print(f"figures: {options.out / 'limit.json'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
