"""Columns that are too large for memory lie in a file without a name, which goes with them."""

import mmap
import os
import tempfile

import numpy as np

from evsdr.errors import check_memory, free_memory

SHARE = 0.25  # of the free memory that columns may take; guessed. A slow disk takes longer than all that follows, so not less


def columns(n: int, kinds: dict[str, type], what: str) -> dict[str, np.ndarray]:
    """Give columns of n entries to be written, on disk if memory is short and a disk has room.

    Parameters
    ----------
    n : int
    kinds : dict
        Type of each column by its name.
    what : str
        What they hold, for a sentence: `a recording of 5 events`.

    Raises
    ------
    InputError
        Neither disk nor memory has room.
    """
    kinds = {name: np.dtype(kind) for name, kind in kinds.items()}
    n_byte = n * sum(kind.itemsize for kind in kinds.values())
    disk = _on_disk(n_byte) if n_byte > SHARE * free_memory() else None
    if disk is None:
        check_memory(what, n_byte, "cut the recording")
        return {name: np.empty(n, kind) for name, kind in kinds.items()}
    out, begin = {}, 0
    for name, kind in sorted(kinds.items(), key=lambda item: -item[1].itemsize):  # so that all are aligned
        out[name] = np.frombuffer(disk, kind, n, begin)
        begin += n * kind.itemsize
    return {name: out[name] for name in kinds}


def _on_disk(n_byte: int) -> mmap.mmap | None:
    """Give a file in the folder for temporary ones, as memory; None where that can't be, or the disk is full."""
    try:
        with tempfile.TemporaryFile() as file:
            os.posix_fallocate(file.fileno(), 0, n_byte)  # for later a full disk would end the process
            return mmap.mmap(file.fileno(), n_byte)
    except (OSError, AttributeError):
        return None
