"""A process that reads spoiled files, one after another, and says what came of each."""

import json
import os
import sys
import traceback
import warnings
from pathlib import Path

import numpy as np

from evsdr import InputError, jit
from experiments.fuzz.targets import TARGETS

ACCEPTED, REFUSED, NOT_FINITE, TRACEBACK = "accepted", "refused", "NaN out", "traceback"


def outcome(read, folder: Path) -> tuple[str, str]:
    """Read a folder; gives what came of it, and words on it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            value = read(folder)
    except InputError as error:
        plain = "\n" not in str(error) and str(error).endswith(".")
        return (REFUSED, str(error)) if plain else (TRACEBACK, f"not one sentence: {error!r}")
    except MemoryError as error:
        return REFUSED, repr(error)
    except Exception:
        return TRACEBACK, traceback.format_exc()
    return (ACCEPTED if finite(value) else NOT_FINITE), ""


def finite(value: object) -> bool:
    """Tell whether all numbers of what was read are finite."""
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    if isinstance(value, (list, tuple)):
        return all(map(finite, value))
    if isinstance(value, (float, np.ndarray, np.generic)) and np.asarray(value).dtype.kind in "fc":
        return bool(np.isfinite(value).all())
    return True


def main() -> None:
    """Answer each line, the number of a target and a folder, by a line of JSON."""
    jit.start()
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever readers print, in C++ too
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        number, folder = json.loads(line)
        print(json.dumps(outcome(TARGETS[number].read, Path(folder))), file=answers, flush=True)


if __name__ == "__main__":
    main()
