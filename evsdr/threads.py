"""Work for all cores: kernels that let go of the interpreter, one chunk per call."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

N_CHUNK = 32  # groups of pixels: enough to keep many cores busy, whatever they hold


def in_chunks(work: Callable[[int], None]) -> None:
    """Call work(chunk) for each of `N_CHUNK`, several at a time."""
    with ThreadPoolExecutor() as threads:
        for _ in threads.map(work, range(N_CHUNK)):
            pass
