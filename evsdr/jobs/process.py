"""One row in a process of its own: memory comes back when it ends, and a crash costs one row."""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import evsdr
from evsdr.jobs.rows import Row
from evsdr.threads import limited

COMMAND = sys.executable, "-m", "evsdr.fit"


@dataclass(frozen=True)
class Ended:
    """How a process ended.

    Attributes
    ----------
    status : int
        Exit status; negative for the signal that killed it.
    said : str
        The last line that it wrote to standard error.
    """

    status: int
    said: str


class Fitting:
    """A fit that runs.

    Parameters
    ----------
    row : Row
    n_thread : int
        Threads that it may use.
    """

    def __init__(self, row: Row, n_thread: int):
        self._told = tempfile.TemporaryFile()
        path = os.pathsep.join(
            filter(None, [str(Path(evsdr.__file__).parents[1]), os.environ.get("PYTHONPATH")])
        )
        self.process = subprocess.Popen(
            [*COMMAND, *row.words],
            cwd=row.folder,
            env=os.environ | limited(n_thread) | {"PYTHONPATH": path},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._told,
            start_new_session=True,  # Ctrl-C is for the batch, which then ends its fits
        )

    def done(self) -> bool:
        """Tell whether it has ended."""
        return self.process.poll() is not None

    def result(self) -> Ended:
        """Wait for its end; once."""
        status = self.process.wait()
        with self._told as file:
            file.seek(0)
            lines = file.read().decode(errors="replace").splitlines()
        return Ended(status, next((line for line in reversed(lines) if line.strip()), ""))

    def cancel(self) -> None:
        """End it at once; results are whole or not there."""
        self.process.kill()
        self.result()


def fit_row(row: Row, n_thread: int) -> Ended:
    """Fit a row in a process of its own, wherever this is called; nothing is done where its results are there already."""
    return Ended(0, "") if row.summary() else Fitting(row, n_thread).result()
