"""Try in a child process what can hang or end the process: libraries that read damaged files."""

import faulthandler
import os
import select
import signal
import warnings
from collections.abc import Callable


def survives(work: Callable[[], object], seconds: float) -> bool:
    """Tell whether work ends, by an exception too, in a copy of this process.

    Parameters
    ----------
    work : callable
        Must use no thread, as a copy has only the one that calls.
    seconds : float
        After which it hangs.

    Returns
    -------
    bool
        False where the copy crashed or hung; True also where a process can't be copied, as on Windows.
    """
    if not hasattr(os, "fork"):
        return True
    ended, held = os.pipe()  # the copy's end closes with it
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads, from Python 3.12 on
            child = os.fork()
    except OSError:
        os.close(ended), os.close(held)
        return True
    if child == 0:
        try:
            faulthandler.disable()
            work()
        finally:
            os._exit(0)
    os.close(held)
    in_time = False
    try:
        in_time = bool(select.select([ended], [], [], seconds)[0])
    finally:
        if not in_time:
            os.kill(child, signal.SIGKILL)
        status = os.waitpid(child, 0)[1]
        os.close(ended)
    return in_time and os.WIFEXITED(status)
