"""`python -m experiments.colour_chart`: reflectance of a colour chart, patch by patch."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console
from rich.table import Table

from evsdr import InputError

from .compute import N_LED, REPOSITORY, find_patches, fit_chart, order_with_pauses, patch_errors
from .draw import draw

OUT = REPOSITORY / "out" / "colour_chart"
CASES = {
    "plain ring": (None, "auto"),
    "dark slots": (order_with_pauses(N_LED), "auto"),
    "dark slots, thresholds known": (order_with_pauses(N_LED), "known"),
}
COLUMNS = {
    "events": ("events", "{:.0f}"),
    "known": ("known", "{:.0%}"),
    "rmse_of_mean": ("of mean", "{:.4f}"),
    "rmse": ("RMSE", "{:.4f}"),
    "sam_deg": ("SAM", "{:.2f}"),
    "angle_deg": ("normal", "{:.2f}"),
}


@dataclass(frozen=True)
class Options:
    """Recover a simulated colour chart, with and without dark slots."""

    size: int = 128
    """Width and height of the images [pixels]."""
    out: Path = OUT
    """Folder for figures and picture."""


def main(argv: list[str] | None = None) -> int:
    """Simulate, fit, print one table per case, write figures and picture."""
    options = tyro.cli(Options, prog="python -m experiments.colour_chart", args=argv)
    console, charts, figures = Console(width=100), {}, {}
    for title, (order, thresholds) in CASES.items():
        try:
            chart = fit_chart(order, options.size, thresholds)
        except InputError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        patches = patch_errors(chart, find_patches(chart.truth))
        charts[title], figures[title] = chart, {"all pixels": chart.error, "patches": patches}
        console.print(table(title, patches))
        print("all pixels: " + ", ".join(f"{key} {value:.4f}" for key, value in chart.error.items()) + "\n")
    options.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(figures, indent=1, allow_nan=False)
    (options.out / "colour_chart.json").write_text(text + "\n")
    draw(charts, options.out / "colour_chart.png")
    print(f"picture: {options.out / 'colour_chart.png'}, figures: {options.out / 'colour_chart.json'}")
    return 0


def patch_names() -> list[str]:
    """Give the names of the patches, row by row from the top left, as colour-science has them."""
    import colour

    return list(colour.SDS_COLOURCHECKERS["BabelColor Average"])


def table(title: str, patches: list[dict]) -> Table:
    """Lay out the errors of each patch, and their mean."""
    out = Table(title=f"Colour chart, {title}", title_justify="left", box=None, padding=(0, 1, 0, 0))
    out.add_column("patch", no_wrap=True)
    for heading, _ in COLUMNS.values():
        out.add_column(heading, justify="right", no_wrap=True, min_width=6)
    mean = {key: sum(patch[key] for patch in patches) / len(patches) for key in COLUMNS}
    for name, patch in zip([*patch_names(), "mean"], [*patches, mean]):
        out.add_row(name, *(form.format(patch[key]) for key, (_, form) in COLUMNS.items()))
    return out


if __name__ == "__main__":
    sys.exit(main())
