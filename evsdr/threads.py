"""Work for all cores: kernels that let go of the interpreter, one chunk per call; fewer where the user asks so."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from threadpoolctl import threadpool_limits

from evsdr.errors import InputError

N_CHUNK = 32  # groups of pixels: enough to keep many cores busy, whatever they hold
ASKED = "EVSDR_THREADS"  # variable of the environment: most threads of a process
LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def in_chunks(work: Callable[[int], None]) -> None:
    """Call work(chunk) for each of `N_CHUNK`, several at a time; after an error no more are begun.

    Each thread takes the next one, this thread, too. Measured by hand (what 40 and 247 pixels share, by 3000 and 19,000 events, 2 cores): 4.3 and 19.5 ms,
    for 5.3 and 22.4 with a task for each.
    """
    chunks = iter(range(N_CHUNK))

    def take() -> None:
        try:
            for chunk in chunks:
                work(chunk)
        finally:
            for _ in chunks:  # after an error the others find none
                pass

    others = min(side_by_side(), N_CHUNK) - 1
    if not others:
        return take()
    with ThreadPoolExecutor(others) as threads:
        helping = [threads.submit(take) for _ in range(others)]
        take()
    for each in helping:
        each.result()


def small_matrices() -> threadpool_limits:
    """Let BLAS work in the thread that calls it, as a context.

    All matrices here are small: its own threads help none of them, and wait busily for the next, on the cores that
    other work needs. Measured (`scenes/sphere.xml`, 64 x 64, 2 cores): a fit takes 10.1 s for 12.4, 15.2 CPU seconds for 21.
    """
    return threadpool_limits(1, user_api="blas")


def side_by_side() -> int:
    """Give how many threads work at a time: as many as the user allows, or one for each core."""
    return most_threads() or max(os.cpu_count() or 1, 2)


def most_threads() -> int | None:
    """Give how many threads the user allows this process; None for as many as there are cores.

    Raises
    ------
    InputError
        The variable EVSDR_THREADS is no whole number above 0.
    """
    text = os.environ.get(ASKED, "")
    if text and (not text.isdecimal() or int(text) < 1):
        raise InputError(f"{ASKED} is {text!r}; set it to a whole number above 0, or to nothing.")
    return int(text) if text else None


def limited(n_thread: int) -> dict[str, str]:
    """Give variables of the environment under which a process uses that many threads."""
    return dict.fromkeys((ASKED, *LIBRARIES), str(n_thread))
