"""`python -m experiments.real_frames`: compare events with least squares on frames that others made of real things."""

import argparse
import sys

import numpy as np
from rich.console import Console
from rich.table import Table

from evsdr import InputError, angular_error_deg

from .compute import Result, methods
from .objects import OBJECTS, REPOSITORY, Frames, data_folder

OUT = REPOSITORY / "out" / "real_frames"
FACING = 0.9  # n_z from which the object faces the camera: 26 degrees
DRAWN = (1, 4, 6, 9)  # least squares, least absolute values, events of an EVK4 without and with dark slots


def main(argv: list[str] | None = None) -> int:
    """Compare all methods on each object, print a table, write a picture."""
    parser = argparse.ArgumentParser(prog="real_frames", description=__doc__)
    parser.add_argument("--object", nargs="+", choices=OBJECTS, default=list(OBJECTS), metavar="NAME")
    parser.add_argument("--step", type=int, default=1, help="use each so many-th row and column")
    options = parser.parse_args(argv)
    for name in options.object:
        file, read = OBJECTS[name]
        path = data_folder() / file
        if not path.is_file():
            print(f"No {name}: {path} is absent; set EVSDR_DATA to the folder that holds it.")
            continue
        frames = read(path).thinned(options.step)
        out = OUT / name.replace(" ", "_")
        try:
            results = list(methods(frames, out))
        except InputError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        Console(width=110).print(table(name, frames, results))
        from .draw import draw

        picture = out.with_suffix(".png")
        draw(frames, [results[i] for i in DRAWN], picture)
        print(f"picture: {picture}")
    return 0


def table(name: str, frames: Frames, results: list[Result]) -> Table:
    """Lay out errors of the normals, reflectance and events of each method."""
    facing = frames.normal[frames.mask][:, 2] > FACING
    headings = ("", "frames", "mean", "median", "facing", "reflectance", "events")
    out = Table(title=f"{name}: angular error of its normals [deg]", box=None, padding=(0, 1, 0, 0))
    for heading in headings:
        out.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for result in results:
        error = angular_error_deg(result.normal, frames.normal)[frames.mask]
        low, high = np.percentile(result.reflectance[frames.mask], (10, 90))
        out.add_row(
            result.method,
            str(result.n_frame),
            *(f"{value:.2f}" for value in (error.mean(), np.median(error), error[facing].mean())),
            f"{low:.2f}-{high:.2f}",
            f"{result.event_rate:.0f}" if result.event_rate else "",
        )
    out.caption = (
        "facing: mean within 26° of the view; reflectance: 10th to 90th percentile;\n"
        "events: per pixel and second"
    )
    return out


if __name__ == "__main__":
    sys.exit(main())
