"""Progress of stages, told to whoever asks, shown as a bar on a terminal or said in lines elsewhere; seconds per stage."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn
from rich.progress import Progress as Bar

Progress = Callable[[str, float], bool | None]  # told (stage, share); True asks to end soon
LINES_S = 20.0  # between lines where there is no terminal
EARLY_S, EARLY = 2.0, 0.08  # seconds and share before which nobody can tell how long it takes
SMALL = 0.1  # part of a plan in percent, of a detail that it does not name
STRAIGHT = 0.8  # of a stage, behind which what was not foreseen still has room


def silent(*_) -> None:
    """Tell nobody."""


def never() -> bool:
    """Say that there is time."""
    return False


@dataclass(frozen=True)
class Plan:
    """How long the stages of a command take relative to each other, in order, so that one bar can show the whole.

    Attributes
    ----------
    stages : dict of str to float
        Of all stages; one that is not there does not move the bar.
    parts : dict of str to float
        Of the details of stages, by their names, each time that one is told; a small one for others. Without any, details
        tell the share of their stage.
    even : tuple of str
        Stages whose details tell the share of their stage all the same.
    """

    stages: Mapping[str, float]
    parts: Mapping[str, float] = field(default_factory=dict)
    even: tuple[str, ...] = ()


class Whole:
    """Share of a whole command, told stage by stage; it never falls."""

    def __init__(self, plan: Plan):
        self.plan = plan
        self.share = 0.0
        self._stage = self._detail = ""
        self._done = self._last = 0.0  # of this stage before this detail; of the detail

    def told(self, what: str, share: float) -> float:
        """Give the share of the whole when `what` ("stage" or "stage, detail") is done to a share."""
        stage, _, detail = what.partition(", ")
        names = list(self.plan.stages)
        if stage not in names:
            return self.share
        if stage != self._stage:
            self._stage, self._detail, self._done, self._last = stage, "", 0.0, 0.0
        if detail != self._detail or share < self._last:
            self._done += self._cost(self._detail)  # it may have ended before its steps were used up
            self._detail = detail
        self._last, inner, cost = share, share, self.plan.stages[stage]
        if detail and self.plan.parts and stage not in self.plan.even:
            inner = _bent((self._done + share * self._cost(detail)) / cost)
        before = sum(self.plan.stages[name] for name in names[: names.index(stage)])
        now = (before + inner * cost) / sum(self.plan.stages.values())
        self.share = max(self.share, min(now, 1.0))
        return self.share

    def _cost(self, detail: str) -> float:
        return self.plan.parts.get(detail, SMALL) if detail else 0.0


def _bent(x: float) -> float:
    """Follow x up to most of the way, then come nearer and nearer to 1."""
    left = 1 - STRAIGHT
    return x if x < STRAIGHT else 1 - left * 2.0 ** ((STRAIGHT - x) / left)


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
        self._told = "", 0.0

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[str, float], bool]]:
        """Time a stage; gives a callable (detail, share) that tells how far it is, and says whether to end soon."""
        self._tell(name, 0.0)
        start = time.perf_counter()
        try:
            yield lambda detail, share: self._tell(f"{name}, {detail}" if detail else name, share)
        finally:
            self.seconds[name] = time.perf_counter() - start

    def ask(self) -> bool:
        """Ask whether to end soon; there is nothing new to tell."""
        return self._tell(*self._told)

    def _tell(self, what: str, share: float) -> bool:
        self._told = what, share
        self.enough = bool(self.progress(what, share)) or self.enough
        return self.enough


class Stages(Seconds):
    """Seconds per stage, and while it lasts one bar for all of them with the time left.

    Where standard error is no terminal a line says so every 20 seconds.

    Parameters
    ----------
    title : str
        What is under way.
    plan : Plan or iterable of str
        Its stages, or their names if they take equally long.
    """

    def __init__(self, title: str, plan: Plan | tuple[str, ...] = ()):
        super().__init__(self.show)
        self._whole = Whole(plan if isinstance(plan, Plan) else Plan(dict.fromkeys(plan, 1.0)))
        self._begin = self._said = time.monotonic()
        console = Console(stderr=True)
        self._terminal = console.is_terminal
        self._progress = Bar(
            TextColumn("{task.description}"),
            BarColumn(bar_width=30),
            TaskProgressColumn(),
            TextColumn("{task.fields[left]}"),
            console=console,
            disable=not self._terminal,
            transient=True,
        )
        self._title = title
        self._task = self._progress.add_task(title, total=1.0, left="")

    def expect(self, plan: Plan) -> None:
        """Go on by another plan, once more is known."""
        self._whole.plan = plan

    def __enter__(self) -> "Stages":
        self._progress.start()
        return self

    def __exit__(self, *_) -> None:
        self._progress.stop()

    def show(self, stage: str, share: float) -> None:
        """Move the bar, or say a line if the last is long ago."""
        whole, now = self._whole.told(stage, share), time.monotonic()
        left = time_left(now - self._begin, whole)
        if self._terminal:
            text = f"{self._title}: {stage}"
            self._progress.update(self._task, completed=whole, description=text, left=left)
        elif now - self._said >= LINES_S:
            self._said = now
            said = f"{self._title}: {whole:.0%}, {stage}{left and ', '}{left}"
            print(said, file=sys.stderr, flush=True)


def time_left(elapsed: float, share: float) -> str:
    """Say how long the rest takes if it goes on as before; nothing while nobody can tell [s]."""
    if elapsed < EARLY_S or not EARLY <= share < 1:
        return ""
    left = elapsed * (1 - share) / share
    return f"about {left / 60:.0f} min left" if left >= 90 else f"about {left:.0f} s left"
