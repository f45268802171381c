"""`python -m experiments.setup_errors`: set-ups that are told wrong, what is found of them, and what `--repair` saves."""

import argparse

from rich.console import Console
from rich.table import Table

from .compute import ALL, SCENES, WRONG, alarm, run


def main(argv: list[str] | None = None) -> None:
    """Print errors as told and repaired, and verdicts on what is told right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=32, help="pixels along a side")
    parser.add_argument("--preset", default="balanced", help="of the fits")
    parser.add_argument("--seed", type=int, default=700, help="of the recordings")
    parser.add_argument(
        "--case", default="", help="only the errors whose names hold this; none: false alarms only"
    )
    options = parser.parse_args(argv)
    console = Console(width=None if Console().is_terminal else 200)
    console.print(error_table(options, Console(stderr=True)))
    if options.case in ("", "none"):
        console.print(alarm_table(options))


def error_table(options: argparse.Namespace, progress: Console) -> Table:
    """Fit each scene with each error."""
    table = Table("told wrong", *SCENES, title="Mean angle in degrees: told right, as told -> with --repair")
    for wrong in WRONG:
        if options.case not in wrong.what:
            continue
        cells = []
        for names in SCENES.values():
            row = run(wrong, names, options.size, options.seed, options.preset)
            verdict = "found" if row.found else row.verdict.partition(":")[0]
            cells.append(f"{row.right:.2f}, {row.before:.1f} -> {row.after:.2f} {verdict}")
            progress.print(f"{wrong.what}, {names[1]}: {cells[-1]}; {row.verdict}")
        table.add_row(wrong.what, *cells)
    return table


def alarm_table(options: argparse.Namespace) -> Table:
    """Judge scenes that are told right."""
    cases = [(crossfade, one_value) for crossfade in (1.0, 0.0) for one_value in (False, True)]
    heads = [f"crossfade {c:g}, {'one threshold' if o else 'thresholds of pixels'}" for c, o in cases]
    table = Table("told right", *heads, title="Verdicts")
    for name, names in ALL.items():
        table.add_row(
            name, *(alarm(names, options.size, options.seed, *case, options.preset)[:150] for case in cases)
        )
    return table


if __name__ == "__main__":
    main()
