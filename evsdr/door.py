"""How `python -m evsdr.NAME` begins."""

import importlib
import signal


def open_door(name: str) -> None:
    """Run a command and end the process with its exit status.

    While its modules are imported, Ctrl-C ends the process at once: nothing is there to clean up, and a traceback would
    tell nothing. A process whose parent ignores Ctrl-C goes on ignoring it.
    """
    listens = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if listens:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    command = importlib.import_module(f"evsdr.commands.{name}")
    if listens:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    raise SystemExit(command.main())
