"""Tables of numbers as text that others wrote: every fault of them becomes a sentence."""

import io
import warnings
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.kind import regular

LARGEST = 64 << 20  # bytes


def read_numbers(path: Path, otherwise: str) -> np.ndarray:
    """Read a CSV of numbers (n_line, n_column); NaN where a cell is none.

    Parameters
    ----------
    path : Path
    otherwise : str
        What the sentence says where this is no such table.

    Raises
    ------
    InputError
        It is none.
    """
    try:
        if regular(path).stat().st_size > LARGEST:
            raise ValueError("it is too large")
        text = path.read_text(encoding="utf-8-sig")
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of files without numbers
            return np.genfromtxt(io.StringIO(text), delimiter=",", comments="#", dtype=float, ndmin=2)
    except (OSError, ValueError, UserWarning) as error:
        raise InputError(f"{path}: {otherwise}.") from error
