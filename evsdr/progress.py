"""Progress of stages, told to whoever asks or shown on a terminal, and seconds per stage."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar

Progress = Callable[[str, float], bool | None]  # told (stage, share); True asks to end soon


def silent(*_) -> None:
    """Tell nobody."""


class Seconds:
    """Seconds per stage.

    Parameters
    ----------
    progress : callable (stage, share) -> bool, optional
        Told what is under way, and which share of it, 0..1, is done; True asks to end soon.

    Attributes
    ----------
    seconds : dict of str to float
        Wall time of each finished stage.
    enough : bool
        Whether it was asked to end soon.
    """

    def __init__(self, progress: Progress | None = None):
        self.seconds: dict[str, float] = {}
        self.progress = progress or silent
        self.enough = False

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[str, float], bool]]:
        """Time a stage; gives a callable (detail, share) that tells how far it is, and says whether to end soon."""
        self._tell(name, 0.0)
        start = time.perf_counter()
        try:
            yield lambda detail, share: self._tell(f"{name}, {detail}", share)
        finally:
            self.seconds[name] = time.perf_counter() - start

    def _tell(self, what: str, share: float) -> bool:
        self.enough = bool(self.progress(what, share)) or self.enough
        return self.enough


class Stages(Seconds):
    """Seconds per stage, and a bar on the terminal while it lasts."""

    def __init__(self, title: str):
        super().__init__(self.show)
        console = Console(stderr=True)
        self._progress = Bar(
            TextColumn("{task.description}"),
            BarColumn(bar_width=30),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self._title = title
        self._task = self._progress.add_task(title, total=1.0)

    def __enter__(self) -> "Stages":
        self._progress.start()
        return self

    def __exit__(self, *_) -> None:
        self._progress.stop()

    def show(self, stage: str, share: float) -> None:
        """Move the bar; a share of 0 starts its clock anew."""
        if share == 0:
            self._progress.reset(self._task)
        self._progress.update(self._task, completed=share, description=f"{self._title}: {stage}")
