"""Dr.Jit's frozen functions, and a guard for them."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import drjit as dr

RECORDINGS = 64  # of a function, for scenes of different build: more are dropped, the oldest first


def recorded(function: Callable) -> Callable:
    """Freeze a function of PyTrees: its kernels are recorded once for each build of its arguments.

    Sizes may change from call to call, as long as no array is made in it whose size is not that of an argument:
    Dr.Jit 1.5 would replay the size. Numbers of Python are part of the build; what changes from recording to
    recording must be an array.
    """
    return dr.freeze(limit=RECORDINGS, warn_after=2**31 - 1)(function)


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
