"""What the commands share: options, plain sentences for errors and warnings, progress, seconds per stage."""

import errno
import os
import platform
import shlex
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from contextlib import suppress

import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text

from evsdr import __version__
from evsdr.errors import InputError, InputWarning, free_memory
from evsdr.signals import stoppable

UNFORESEEN = 70  # EX_SOFTWARE of sysexits.h
LIBRARY = 256 << 20  # bytes; the largest that is loaded, LLVM's, is about half of that
LESS = "use a smaller film or fewer events, or close other programs"


def run_command(
    name: str, options_type: type, command: Callable[..., int | None], argv: list[str] | None
) -> int:
    """Parse options and run a command.

    Parameters
    ----------
    name : str
        Its module in evsdr.
    options_type : type
        Dataclass of the command's options; its docstring is the help.
    command : callable (options) -> int, optional
        The work; it may give the exit status.
    argv : list of str, optional
        Arguments; those of the process if None.

    Returns
    -------
    int
        Exit status: that of the command, 0 by default; 2 for input that can't be used, with one sentence on standard
        error; 70 for what nobody has foreseen, with a sentence that names a file with the traceback, and where memory
        runs out; 130 when stopped by Ctrl-C, 129 and 143 by SIGHUP and SIGTERM.
    """
    prog, config = f"python -m evsdr.{name}", (tyro.conf.AvoidSubcommands,)
    came: list[int] = []  # signals that stop
    with warnings.catch_warnings():
        warnings.simplefilter("always", InputWarning)
        warnings.showwarning = lambda message, *_: print(f"warning: {message}", file=sys.stderr)
        try:
            with stoppable(came):
                return command(tyro.cli(options_type, prog=prog, args=argv, config=config)) or 0
        except InputError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt as stop:
            return stopped_by(came[0] if came else signal.SIGINT, str(stop))
        except BrokenPipeError:  # who read the output has gone
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return UNFORESEEN
        except Exception as error:
            if came:  # compiled code makes other errors of it
                return stopped_by(came[0], "")
            what = f"the memory ran out; {LESS}." if _of_memory(error) else _unforeseen(name, argv, error)
            print(f"error: {what}", file=sys.stderr)
            return UNFORESEEN


def stopped_by(number: int, what: str) -> int:
    """Say that a signal has stopped a command, and what was done; gives the exit status, 128 and its number."""
    with suppress(OSError):  # the terminal may be gone
        print(f"stopped; {what or 'nothing was written.'}", file=sys.stderr, flush=True)
    return 128 + number


def _of_memory(error: Exception) -> bool:
    """Tell whether memory ran out; Dr.Jit and threads have words of their own for that."""
    if isinstance(error, (OSError, ImportError)):  # a library for which there is no room says something else
        return getattr(error, "errno", None) == errno.ENOMEM or free_memory() < LIBRARY
    words = ("out of memory", "allocation cache", "bad_alloc", "can't start new thread")
    return isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError) and any(word in str(error) for word in words)
    )


def _unforeseen(name: str, argv: list[str] | None, error: Exception) -> str:
    """Write the traceback of a defect into a file; gives a sentence that names it."""
    told = sys.argv[1:] if argv is None else argv
    text = f"evsdr {__version__}, Python {sys.version}, {platform.platform()}\n{shlex.join([name, *map(str, told)])}\n\n"
    text += "".join(traceback.format_exception(error))
    what = f"evsdr.{name} met what nobody had foreseen ({type(error).__name__})"
    try:
        handle, path = tempfile.mkstemp(prefix=f"evsdr-{name}-", suffix=".log")
        with open(handle, "w", encoding="utf-8", errors="replace") as file:
            file.write(text)
    except OSError:
        return f"{what}, and no file can be written to tell of it; make room in {tempfile.gettempdir()}."
    return f"{what}; please report it with {path}."


def print_table(title: str, rows: list[tuple[str, str]]) -> None:
    """Print names and figures."""
    text = Text(title)  # brackets in it are no markup
    table = Table(title=text, show_header=False, min_width=max(line.cell_len for line in text.split()))
    table.add_column()
    table.add_column(justify="right")
    for row in rows:
        table.add_row(*map(Text, row))
    Console().print(table)
