"""What the commands share: options, plain sentences for errors and warnings, progress, seconds per stage."""

import sys
import warnings
from collections.abc import Callable

import tyro
from rich.console import Console
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


def print_table(title: str, rows: list[tuple[str, str]]) -> None:
    """Print names and figures."""
    table = Table(title=Text(title), show_header=False)  # Text: brackets in it are no markup
    table.add_column()
    table.add_column(justify="right")
    for row in rows:
        table.add_row(*map(Text, row))
    Console().print(table)
