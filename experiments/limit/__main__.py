"""`python -m experiments.limit`: how close a fit comes to the limit of Cramer and Rao, and what that depends on."""

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
SWEPT = ("sphere", "blob", "colorchecker")
PRESETS = ("fast", "balanced")
BASE_VALUE = {"constant light": 0.05, "noise": 10, "rounds": 6}  # on the figure's axes


@dataclass(frozen=True)
class Options:
    """Compare errors with the limit of Cramer and Rao over constant light, threshold, noise and rounds."""

    quick: bool = False
    """Only the base case, and that of an EVK4."""
    own_light: int = 0
    """Only so many recordings of the light that the model has, each pixel solved alone: how near the solver is."""
    size: int = 64
    """Width and height of the images [pixels]."""
    out: Path = OUT
    """Folder for limit.json, limit.md and limit.png."""


def main(argv: list[str] | None = None) -> int:
    """Run all cases, print tables as they come, write figures and picture."""
    options = tyro.cli(Options, prog="python -m experiments.limit", args=argv)
    options.out.mkdir(parents=True, exist_ok=True)
    jit.start()
    from . import compute

    console = Console(width=120)
    if options.own_light:
        scenes = (compute.render(name, options.size) for name in SCENES)
        own = [
            row for scene in scenes for row in compute.run_own_light(scene, compute.BASE, options.own_light)
        ]
        console.print(tables.own_table(own))
        return 0
    rows, base, signal = [], [], {}
    for name in SCENES:
        rendered = compute.render(name, options.size)
        signal[name] = compute.led_signal(rendered)
        found = compute.run(rendered, compute.BASE, PRESETS, own=True)
        base += found + compute.run(rendered, compute.EVK4, ("balanced",))
        console.print(
            tables.case_table(
                f"\n{name}, base case, then an EVK4", "preset", [row for row in base if row["scene"] == name]
            )
        )
        for parameter, settings in compute.SWEEPS.items() if name in SWEPT and not options.quick else ():
            swept = []
            for value, setting in settings:
                some = [row for row in found if row["preset"] == "balanced"]
                case = some if setting == compute.BASE else compute.run(rendered, setting)
                swept += [row | {"parameter": parameter, "value": value} for row in case]
            console.print(tables.case_table(f"\n{name}, {parameter}", "value", swept))
            rows += swept
    ratios = summary.median_ratios(base)
    result = {"base": base, "median ratio": ratios, "LED signal": signal}
    console.print(tables.calibration_table(base))
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
