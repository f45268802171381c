"""How `python -m evsdr.NAME` begins."""

import importlib
import signal
import sys

from evsdr.errors import lacking


def open_door(name: str) -> None:
    """Run a command and end the process with its exit status.

    While its modules are imported, Ctrl-C ends the process at once: nothing is there to clean up, and a traceback would
    tell nothing. A process whose parent ignores Ctrl-C goes on ignoring it. A Python that lacks a package that evsdr
    needs ends with the status 2.
    """
    listens = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if listens:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        command = importlib.import_module(f"evsdr.commands.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "evsdr").partition(".")[0] == "evsdr":
            raise
        print(f"error: {lacking(error.name)}", file=sys.stderr)
        raise SystemExit(2) from error
    if listens:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    raise SystemExit(command.main())
