"""What the commands share: options, plain sentences for errors and warnings, progress, seconds per stage."""

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from evsdr.errors import InputError


def run_command(options_type: type, command: Callable[..., None], argv: list[str] | None) -> int:
    """Parse options and run a command.

    Parameters
    ----------
    options_type : type
        Dataclass of the command's options; its docstring is the help.
    command : callable (options) -> None
        The work.
    argv : list of str, optional
        Arguments; those of the process if None.

    Returns
    -------
    int
        Exit status: 0; 2 for input that can't be used, with one sentence on standard error; 130 when
        stopped by Ctrl-C.
    """
    options = tyro.cli(options_type, args=argv, config=(tyro.conf.AvoidSubcommands,))
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_: print(f"warning: {message}", file=sys.stderr)
        try:
            command(options)
        except InputError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print("stopped; nothing was written.", file=sys.stderr)
            return 130
    return 0


def parse_definitions(define: tuple[str, ...]) -> dict[str, str]:
    """Read `name=value` pairs for the `<default>` parameters of a scene file."""
    pairs = [text.partition("=") for text in define]
    for name, equals, _ in pairs:
        if not name or not equals:
            raise InputError(f"-D {name}{equals}: write it as -D name=value.")
    return {name: value for name, _, value in pairs}


def print_table(title: str, rows: list[tuple[str, str]]) -> None:
    """Print names and figures."""
    table = Table(title=title, show_header=False)
    table.add_column()
    table.add_column(justify="right")
    for row in rows:
        table.add_row(*row)
    Console().print(table)


class Stages:
    """Progress on screen and seconds per stage.

    Attributes
    ----------
    seconds : dict of str to float
        Wall time of each finished stage.
    """

    def __init__(self, title: str, quiet: bool = False):
        self.seconds: dict[str, float] = {}
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=30),
            TimeElapsedColumn(),
            console=Console(stderr=True),
            disable=quiet,
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
