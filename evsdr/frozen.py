"""A guard for Dr.Jit's frozen functions."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Keep Python's cycle collector quiet while frozen functions are recorded.

    Dr.Jit 1.5 aborts the process if an array that borrows memory from NumPy is freed during a recording, and
    the collector frees garbage of earlier work at any moment.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
