"""Run the rows of a batch on an engine, and tell how each ended."""

import csv
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from evsdr.files.atomic import atomic_path
from evsdr.jobs.engines import Future, Submit
from evsdr.jobs.process import Ended
from evsdr.jobs.rows import Row

TRIES = 3  # of a row whose process is killed
REST = 0.1  # seconds between looks at what runs


@dataclass(frozen=True)
class Outcome:
    """A row of the table at the end; what is not known is empty."""

    scene: str
    events: str
    options: str
    out: str
    state: str
    """`done`, `done before`, `refused`, `failed` or `killed`."""
    tries: int
    verdict: str = ""
    known: float | str = ""
    """Share of the solved pixels that are known."""
    mae_deg: float | str = ""
    sam_deg: float | str = ""
    rmse: float | str = ""
    seconds: float | str = ""
    said: str = ""
    """Why there are no results."""


def run_rows(rows: list[Row], submit: Submit, n_job: int, tell: Callable[[Outcome], None]) -> list[Outcome]:
    """Run all rows that have no results yet, some at a time; those whose process is killed once more.

    Parameters
    ----------
    rows : list of Row
    submit : callable (row) -> Future
        Starts a row, see `engines`.
    n_job : int
        Most rows at a time.
    tell : callable (Outcome)
        Told of each row when it ends.

    Returns
    -------
    list of Outcome, in the order of the rows
    """
    outcomes: dict[Row, Outcome] = {}
    running: dict[Row, Future] = {}
    tries = dict.fromkeys(rows, 0)

    def end(row: Row, ended: Ended) -> None:
        outcomes[row] = outcome(row, ended, tries[row])
        tell(outcomes[row])

    waiting: deque[Row] = deque()
    for row in rows:
        if row.summary():
            end(row, Ended(0, ""))
        else:
            waiting.append(row)
    try:
        while waiting or running:
            while waiting and len(running) < n_job:
                row = waiting.popleft()
                tries[row] += 1
                running[row] = submit(row)
            for row in [row for row, future in running.items() if future.done()]:
                ended = _ended(running.pop(row))
                if ended.status < 0 and tries[row] < TRIES and not row.summary():
                    waiting.appendleft(row)
                else:
                    end(row, ended)
            time.sleep(REST if running else 0)
    finally:
        for future in running.values():
            future.cancel()
    return [outcomes[row] for row in rows]


def _ended(future: Future) -> Ended:
    """Give how a row ended; that its worker was lost is as if it was killed."""
    try:
        return future.result()
    except Exception as error:  # of the engine: a fit's own are exit statuses
        return Ended(-1, f"its worker was lost ({' '.join(str(error).split())[:200]})")


def outcome(row: Row, ended: Ended, tries: int) -> Outcome:
    """Tell what became of a row: what lies in its folder counts."""
    told = {name: getattr(row, name) for name in ("scene", "events", "options", "out")}
    summary = row.summary()
    if summary is None:
        state = "killed" if ended.status < 0 else "refused" if ended.status == 2 else "failed"
        return Outcome(**told, state=state, tries=tries, said=ended.said.removeprefix("error: "))
    numbers, error = summary["numbers"], summary.get("error", {})
    return Outcome(
        **told,
        state="done" if tries else "done before",
        tries=tries,
        verdict=summary["verdict"],
        known=round(numbers["pixels_known"] / max(numbers["pixels_solved"], 1), 4),
        **{name: error[name] for name in ("mae_deg", "sam_deg", "rmse") if name in error},
        seconds=round(sum(summary["seconds"].values()), 2),
    )


def write_table(path: Path, outcomes: list[Outcome]) -> None:
    """Write how all rows ended, a CSV.

    Raises
    ------
    InputError
        The file can't be written.
    """
    with atomic_path(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Outcome)])
        writer.writeheader()
        writer.writerows(asdict(outcome) for outcome in outcomes)
