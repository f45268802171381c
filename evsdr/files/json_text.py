"""JSON that others wrote: every fault of it becomes a sentence."""

import json
from pathlib import Path

from evsdr.errors import InputError
from evsdr.files.kind import regular

LARGEST = 64 << 20  # bytes
MOST_DIGITS = 18  # of a whole number: no larger one is meant, and floats end at 308


def read_json(path: Path, wanted: str) -> object:
    """Read a JSON file, whatever it holds.

    Parameters
    ----------
    path : Path
    wanted : str
        What to name instead, for the sentence: "the ring.json of this recording".

    Raises
    ------
    InputError
        The file is missing, too large, or no JSON.
    """
    try:
        if regular(path).stat().st_size > LARGEST:
            raise InputError(f"{path}: this is larger than {LARGEST >> 20} MiB; name {wanted}.")
        return json.loads(path.read_text(encoding="utf-8"), parse_int=_whole)
    except OSError as error:
        raise InputError(f"{path}: there is no readable file; name {wanted}.") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: this is not JSON; name {wanted}.") from error


def _whole(text: str) -> int:
    if len(text.lstrip("-")) > MOST_DIGITS:
        raise ValueError("a number of too many digits")
    return int(text)
