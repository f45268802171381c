"""Signals that stop a command: so that it cleans up, and never in the middle of what must not be cut."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

AGAIN = 2.0  # seconds after which a stop is raised again: callbacks of compiled code swallow some
STOPS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
ALARM = tuple(getattr(signal, name) for name in ("SIGALRM",) if hasattr(signal, name))


@contextmanager
def stoppable(came: list[int]) -> Iterator[None]:
    """Let Ctrl-C, SIGTERM and SIGHUP raise KeyboardInterrupt, again and again until it comes through.

    Signals that the parent of this process ignores, or that others handle, stay as they are; only the first thread of a
    process can listen.

    Parameters
    ----------
    came : list of int
        Gets the numbers of those that came.
    """

    def again(*_):
        raise KeyboardInterrupt

    def stop(number, _):
        came.append(number)
        if ALARM:
            signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)
        raise KeyboardInterrupt

    before = _handlers(STOPS + ALARM)
    before = {
        n: handler for n, handler in before.items() if handler in (signal.SIG_DFL, signal.default_int_handler)
    }
    for number in before:
        signal.signal(number, again if number in ALARM else stop)
    try:
        with _quiet():
            yield
    finally:
        if ALARM and before:
            signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _quiet() -> Iterator[None]:
    """Say nothing of stops that came where nothing can be raised, as in destructors: they come again."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda told: None if isinstance(told.exc_value, KeyboardInterrupt) else hook(told)
    try:
        yield
    finally:
        sys.unraisablehook = hook


class Patience:
    """Stops that wait: once it has begun, the first is only noted, for whoever looks; the next stops as before.

    Attributes
    ----------
    came : signal.Signals, optional
        The one that was noted.
    """

    def __init__(self):
        self.came: signal.Signals | None = None
        self._before: dict = {}

    def begin(self) -> None:
        """Let the first stop wait from now on, to the end of the `with` block; again, it changes nothing."""
        if self._before:
            return
        self._before = {n: handler for n, handler in _handlers(STOPS).items() if callable(handler)}
        for number in self._before:
            signal.signal(number, self._note)

    def _note(self, number: int, _) -> None:
        self.came = signal.Signals(number)
        self._end()

    def _end(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __enter__(self) -> "Patience":
        return self

    def __exit__(self, *_) -> None:
        if self.came is None:
            self._end()


@contextmanager
def undisturbed() -> Iterator[None]:
    """Let signals wait. A mask would not do: other threads of the process hear them, and Python acts in the first one."""
    came: list[int] = []
    before = {n: handler for n, handler in _handlers(STOPS + ALARM).items() if callable(handler)}
    for number in before:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    for number in came[:1]:
        signal.raise_signal(number)


def _handlers(numbers: tuple[int, ...]) -> dict:
    """Give what signals do now; nothing in other threads than the first."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    return {number: signal.getsignal(number) for number in numbers}
