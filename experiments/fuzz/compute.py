"""Spoil files and have a child process read them: a reader that hangs or ends its process ends nobody else's."""

import json
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.fuzz.targets import TARGETS, write_all

ENDED, HANG = "ended process", "hang"
PATIENCE = 60.0  # seconds after which a reader hangs
LAST_WORDS = 5000  # characters of what a process said before it ended


@dataclass(frozen=True)
class Case:
    """What came of a spoiled file.

    Attributes
    ----------
    target, seed : int
        Which file, and what spoiled it.
    outcome, words : str
    """

    target: int
    seed: int
    outcome: str
    words: str


class Reader:
    """A child process that reads; a new one takes the place of one that ended, and is given its file again."""

    def __init__(self, patience: float = PATIENCE):
        self.patience, self.child, self.said, self.n_read = patience, None, None, 0

    def read(self, target: int, folder: Path) -> tuple[str, str]:
        """Give what comes of a folder; if the process ends, also its last words, and what a new one makes of it."""
        earlier = self.n_read
        outcome, words = self._ask(target, folder)
        if outcome in (ENDED, HANG):
            again = self._ask(target, folder)
            self.close()
            words = f"{words}\nafter {earlier} other files; alone: {': '.join(again)}"
        return outcome, words

    def _ask(self, target: int, folder: Path) -> tuple[str, str]:
        if self.child is None:
            self._start()
        print(json.dumps([target, str(folder)]), file=self.child.stdin, flush=True)
        self.n_read += 1
        answers = select.select([self.child.stdout], [], [], self.patience)[0]
        if not answers:
            self.child.send_signal(signal.SIGABRT)  # faulthandler says where it is
            self.child.wait()
        line = self.child.stdout.readline()
        if line:
            return tuple(json.loads(line))
        status = self.child.wait()
        self.said.seek(0)
        said = self.said.read()[-LAST_WORDS:]
        self.close()
        return (ENDED, f"status {status}\n{said}") if answers else (HANG, f"{self.patience:g} s\n{said}")

    def _start(self) -> None:
        self.said, self.n_read = tempfile.TemporaryFile("w+", errors="replace"), 0
        command = [sys.executable, "-X", "faulthandler", "-m", "experiments.fuzz.worker"]
        pipes = dict(stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.said, text=True)
        self.child = subprocess.Popen(command, cwd=Path(__file__).parents[2], **pipes)
        if self.child.stdout.readline() != "ready\n":
            raise RuntimeError("the reader does not start")

    def close(self) -> None:
        """End the process."""
        if self.child is not None:
            self.child.kill()
            self.child.communicate()
            self.said.close()
            self.child = None


@contextmanager
def playground() -> Iterator[Path]:
    """Give a folder with a whole file of each kind in `whole`."""
    with tempfile.TemporaryDirectory(prefix="evsdr-fuzz-") as name:
        (Path(name) / "whole").mkdir()
        write_all(Path(name) / "whole")
        yield Path(name)


def fuzz(seconds: float, seed: int = 0, patience: float = PATIENCE, keep: Path | None = None) -> list[Case]:
    """Spoil one file after another, each kind in turn, until the time is over.

    Parameters
    ----------
    keep : Path, optional
        Gets the files whose reader failed.
    """
    reader, cases = Reader(patience), []
    with playground() as folder:
        end = time.monotonic() + seconds
        try:
            while time.monotonic() < end:
                target = len(cases) % len(TARGETS)
                cases.append(one(reader, folder, target, seed + len(cases) // len(TARGETS)))
                if keep and cases[-1].outcome not in ("accepted", "refused"):
                    case, file = cases[-1], TARGETS[target].file
                    keep.mkdir(parents=True, exist_ok=True)
                    shutil.copy(
                        folder / "spoiled" / file, keep / f"{case.outcome[:4].strip()}_{case.seed}_{file}"
                    )
        finally:
            reader.close()
    return cases


def one(reader: Reader, folder: Path, target: int, seed: int) -> Case:
    """Spoil a file and have it read."""
    spoiled = folder / "spoiled"
    shutil.rmtree(spoiled, ignore_errors=True)
    shutil.copytree(folder / "whole", spoiled)
    try:
        TARGETS[target].spoil(spoiled / TARGETS[target].file, np.random.default_rng([target, seed]))
    except Exception as error:  # HDF5 refuses some
        return Case(target, seed, "accepted", f"not spoiled: {error!r}")
    return Case(target, seed, *reader.read(target, spoiled))


def table(cases: list[Case]) -> list[tuple[str, Counter]]:
    """Count outcomes for each file."""
    counts: dict[str, Counter] = {target.file: Counter() for target in TARGETS}
    for case in cases:
        counts[TARGETS[case.target].file][case.outcome] += 1
    return list(counts.items())
