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
from rich.text import Text

from evsdr.errors import InputError, InputWarning


def run_command(name: str, options_type: type, command: Callable[..., None], argv: list[str] | None) -> int:
    """Parse options and run a command.

    Parameters
    ----------
    name : str
        Its module in evsdr.
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
    prog, config = f"python -m evsdr.{name}", (tyro.conf.AvoidSubcommands,)
    with warnings.catch_warnings():
        warnings.simplefilter("always", InputWarning)
        warnings.showwarning = lambda message, *_: print(f"warning: {message}", file=sys.stderr)
        try:
            command(tyro.cli(options_type, prog=prog, args=argv, config=config))
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
    for name, equals, value in pairs:
        if not name or not equals:
            raise InputError(f"-D {name}{equals}{value}: write it as -D name=value.")
    return {name: value for name, _, value in pairs}


def check_range(name: str, value: int, least: int, most: int = 2**32 - 1) -> None:
    """Refuse a number outside a range.

    Raises
    ------
    InputError
        It is.
    """
    if not least <= value <= most:
        raise InputError(f"{name} is {value}; give a whole number from {least} to {most}.")


def print_table(title: str, rows: list[tuple[str, str]]) -> None:
    """Print names and figures."""
    table = Table(title=Text(title), show_header=False)  # Text: brackets in it are no markup
    table.add_column()
    table.add_column(justify="right")
    for row in rows:
        table.add_row(*map(Text, row))
    Console().print(table)


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
