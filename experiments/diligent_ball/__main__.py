"""`python -m experiments.diligent_ball`: compare events with least squares on photographs of a real ball."""

import sys

import numpy as np
from rich.console import Console
from rich.table import Table

from evsdr import InputError, angular_error_deg

from .compute import REPOSITORY, Ball, Result, data_path, methods, read_ball

OUT = REPOSITORY / "out" / "diligent_ball"
FACING = 0.9  # n_z from which the ball faces the camera: 26 degrees
DRAWN = (1, 3, 5, 7)  # least squares, its best, events of an EVK4 without and with dark slots


def main() -> int:
    """Compare all methods, print a table, write a picture."""
    path = data_path()
    if not path.is_file():
        print(f"Nothing to do: {path} is absent; set EVSDR_DATA to the folder that holds it.")
        return 0
    ball = read_ball(path)
    try:
        results = list(methods(ball, OUT))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    Console().print(table(ball, results))
    from .draw import draw

    picture = OUT / "diligent_ball.png"
    draw(ball, [results[i] for i in DRAWN], picture)
    print(f"picture: {picture}")
    return 0


def table(ball: Ball, results: list[Result]) -> Table:
    """Lay out errors of the normals, reflectance and events of each method."""
    facing = ball.normal[ball.mask][:, 2] > FACING
    headings = ("", "photos", "mean", "median", "facing", "reflectance", "events")
    out = Table(title="A real ball: angular error of its normals [deg]", box=None, padding=(0, 1, 0, 0))
    for heading in headings:
        out.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for result in results:
        error = angular_error_deg(result.normal, ball.normal)[ball.mask]
        low, high = np.percentile(result.reflectance[ball.mask], (10, 90))
        out.add_row(
            result.method,
            str(result.n_photograph),
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
