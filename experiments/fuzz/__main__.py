"""`python -m experiments.fuzz --minutes N`: how readers stand files that are spoiled."""

from collections import Counter
from pathlib import Path

import tyro
from rich.console import Console
from rich.table import Table

from experiments.fuzz.compute import ENDED, HANG, TARGETS, fuzz, table
from experiments.fuzz.worker import ACCEPTED, NOT_FINITE, REFUSED, TRACEBACK

OUTCOMES = ACCEPTED, REFUSED, TRACEBACK, ENDED, HANG, NOT_FINITE


def main(minutes: float = 1.0, seed: int = 0, keep: Path | None = None) -> None:
    """Spoil files of every kind that evsdr reads.

    Parameters
    ----------
    minutes : float
        How long.
    seed : int
        Of the first file of each kind; the next has the next.
    keep : Path
        Folder for files whose reader failed.
    """
    cases = fuzz(60 * minutes, seed, keep=keep)
    shown = Table("file", "files", *OUTCOMES, box=None)
    rows = table(cases)
    for name, count in [*rows, ("all", sum((count for _, count in rows), Counter()))]:
        shown.add_row(name, str(count.total()), *(str(count[outcome]) for outcome in OUTCOMES))
    console = Console()
    console.print(shown)
    for case in cases:
        if case.outcome not in (ACCEPTED, REFUSED):
            console.rule(f"{case.outcome}: {TARGETS[case.target].file}, seed {case.seed}")
            console.print(case.words, markup=False)


if __name__ == "__main__":
    tyro.cli(main)
