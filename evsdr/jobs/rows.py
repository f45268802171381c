"""The table of a batch: a row is a fit."""

import csv
import shlex
from dataclasses import dataclass
from pathlib import Path

from evsdr.errors import InputError
from evsdr.files.kind import regular
from evsdr.files.maps import read_results

COLUMNS = "scene", "events", "options", "out"


@dataclass(frozen=True)
class Row:
    """A fit: what `python -m evsdr.fit` is told, in the folder where relative paths begin."""

    folder: Path
    scene: str
    events: str
    options: str = ""
    out: str = ""

    @property
    def words(self) -> list[str]:
        """Arguments of the command."""
        return [self.scene, self.events, "--out", self.out, *shlex.split(self.options)]

    @property
    def results(self) -> Path:
        """Folder of the results."""
        return self.folder / self.out

    def summary(self) -> dict | None:
        """Give the summary if the whole fit is there: of this command, not stopped, no older than what it was made of."""
        try:
            _, summary = read_results(self.results)
        except InputError:
            return None
        same = summary.get("command") == f"python -m evsdr.fit {shlex.join(self.words)}"
        whole = not summary.get("stopped") or summary.get("stopped_by") == "time budget"
        return summary if same and whole and not self._older() else None

    def _older(self) -> bool:
        made = (self.results / "summary.json").stat().st_mtime
        sources = (self.folder / self.scene, self.folder / self.events)
        return any(source.is_file() and source.stat().st_mtime > made for source in sources)


def read_rows(path: Path) -> list[Row]:
    """Read a jobs.csv: columns `scene` and `events`, and if wanted `options` and `out`.

    Parameters
    ----------
    path : Path
        Paths in it begin in its folder. `out` is by default named after the events.

    Raises
    ------
    InputError
        It is missing, has other columns, an empty or unreadable field, or two rows write to one folder.
    """
    try:
        with open(regular(path), encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, strict=True)
            names, lines = reader.fieldnames or (), list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: there is no readable table; name a CSV file with {columns()}.") from error
    if not {"scene", "events"} <= set(names) <= set(COLUMNS):
        raise InputError(f"{path}: its columns are {', '.join(names) or 'none'}; name {columns()}.")
    rows = [_row(path, number, line) for number, line in enumerate(lines, 2)]
    if not rows:
        raise InputError(f"{path}: it has no rows; write one for each fit.")
    seen: dict[Path, int] = {}
    for number, row in enumerate(rows, 2):
        first = seen.setdefault(row.results.resolve(), number)
        if first != number:
            raise InputError(
                f"{path}: lines {first} and {number} both write to {row.out}; give each its own out."
            )
    return rows


def columns() -> str:
    """Name the columns of a jobs.csv."""
    return "columns scene and events, and options and out if wanted"


def _row(path: Path, number: int, line: dict) -> Row:
    """Check one line of the table."""
    if None in line or None in line.values():
        raise InputError(f"{path}: line {number} has not as many fields as the header; mend it.")
    told = {name: value.strip() for name, value in line.items()}
    if not told["scene"] or not told["events"]:
        raise InputError(f"{path}: line {number} has no scene or no events; name both.")
    told["out"] = told.get("out") or str(Path(told["events"]).with_suffix(""))
    try:
        options = shlex.split(told.get("options", ""))
    except ValueError as error:
        raise InputError(f"{path}: line {number}: a quote in the options does not end; mend it.") from error
    if any(word.partition("=")[0] == "--out" for word in options):
        raise InputError(f"{path}: line {number} names --out in the options; use the column out.")
    return Row(path.resolve().parent, **told)
