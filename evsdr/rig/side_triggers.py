"""Read triggers that lie in a file of their own beside the events."""

import string
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.numbers import read_numbers
from evsdr.rig.camera_file import Edges
from evsdr.rig.eventps import is_xz, unpack

TEXT = frozenset(string.printable.encode() + b"\xef\xbb\xbf")
HEAD = 1 << 12  # bytes that tell text from binary
LATEST_US = 2.0**53  # that float64 tells to the microsecond


def read_triggers(path: Path) -> Edges:
    """Read times as rising edges of input 0.

    Parameters
    ----------
    path : Path
        Text with a time [us] in each line, or float32 seconds, packed by xz or not, as EventPS has them.

    Raises
    ------
    InputError
        It is neither, or its times don't grow.
    """
    wanted = "write a time in microseconds in each line"
    try:
        if not path.is_file():
            raise InputError(f"{path}: there is no such file; name the file of triggers.")
        t = _seconds(path, wanted) if is_xz(path) or not _is_text(path) else _lines(path, wanted)
    except OSError as error:
        raise InputError(f"{path}: it can't be read ({error.strerror or error}); copy it again.") from error
    if not len(t) or not np.isfinite(t).all() or np.abs(t).max() > LATEST_US or (np.diff(t) <= 0).any():
        raise InputError(f"{path}: its {len(t)} times are not finite or do not grow; {wanted}.")
    t = np.rint(t).astype(np.int64)
    return Edges(np.ones(len(t), np.int8), t, np.zeros(len(t), np.int16))


def _is_text(path: Path) -> bool:
    with open(path, "rb") as file:
        head = file.read(HEAD)
    return set(head) <= TEXT


def _seconds(path: Path, wanted: str) -> np.ndarray:
    data = unpack(path) if is_xz(path) else path.read_bytes()
    if len(data) % 4:
        raise InputError(f"{path}: this is neither text nor a list of float32 seconds; {wanted}.")
    return 1e6 * np.frombuffer(data, "<f4").astype(np.float64)


def _lines(path: Path, wanted: str) -> np.ndarray:
    table = read_numbers(path, wanted)
    if table.shape[1] != 1:
        raise InputError(f"{path}: its lines hold {table.shape[1]} numbers; {wanted}.")
    return table[:, 0]
