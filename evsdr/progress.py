"""Progress on a terminal, and seconds per stage."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


class Stages:
    """Progress on a terminal and seconds per stage.

    Attributes
    ----------
    seconds : dict of str to float
        Wall time of each finished stage.
    """

    def __init__(self, title: str):
        self.seconds: dict[str, float] = {}
        console = Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=30),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self._title = title

    def __enter__(self) -> "Stages":
        self._progress.start()
        return self

    def __exit__(self, *_) -> None:
        self._progress.stop()

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[str, float], None]]:
        """Time a stage; gives a callable (detail, share) that moves its bar."""
        task = self._progress.add_task(f"{self._title}: {name}", total=1.0)

        def advance(detail: str, share: float) -> None:
            self._progress.update(task, completed=share, description=f"{self._title}: {name}, {detail}")

        start = time.perf_counter()
        try:
            yield advance
        finally:
            self.seconds[name] = time.perf_counter() - start
            self._progress.update(task, completed=1.0)
            self._progress.remove_task(task)
