"""Arrays of NumPy that others wrote, .npz and .npy: every fault of them becomes a sentence."""

import zipfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from evsdr.errors import InputError, check_memory
from evsdr.files.kind import regular

COPIES = 3  # of an array that its checks take


def read_npz(path: Path, names: Iterable[str], wanted: str) -> dict[str, np.ndarray]:
    """Read those of some arrays that an archive holds.

    Parameters
    ----------
    path : Path
    names : iterable of str
    wanted : str
        What to name or do instead, for the sentence: "write it by numpy.savez".

    Raises
    ------
    InputError
        The file is no archive of arrays, or damaged.
    """
    try:
        with regular(path).open("rb") as stream:
            with zipfile.ZipFile(stream) as archive:
                entries = archive.infolist()
                size = sum(entry.file_size for entry in entries)
            check_memory(f"{path}: its arrays", COPIES * size, wanted)
            stream.seek(0)
            file = np.load(stream, allow_pickle=False)
            arrays = {name: file[name] for name in names if name in file.keys()}
    except (InputError, MemoryError):
        raise
    except Exception as error:  # NumPy, zipfile and zlib raise ten kinds on damage
        raise InputError(f"{path}: this is not a readable .npz archive; {wanted}.") from error
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):  # a member without .npy comes as bytes
            raise InputError(f"{path}: {name} is no array; {wanted}.")
    return arrays


def read_npy(path: Path, wanted: str) -> np.ndarray:
    """Read an array.

    Raises
    ------
    InputError
        The file is no array, or damaged.
    """
    try:
        with regular(path).open("rb") as stream:
            version = np.lib.format.read_magic(stream)
            header = {
                (1, 0): np.lib.format.read_array_header_1_0,
                (2, 0): np.lib.format.read_array_header_2_0,
            }
            shape, _, dtype = header[version](stream)
            size = dtype.itemsize * int(np.prod([int(n) for n in shape], dtype=object))
            if size > path.stat().st_size:
                raise ValueError("it is cut short")
            check_memory(f"{path}: its array", COPIES * size, wanted)
            stream.seek(0)
            return np.load(stream, allow_pickle=False)
    except (InputError, MemoryError):
        raise
    except Exception as error:  # NumPy raises ten kinds on damage
        raise InputError(f"{path}: this is not a readable .npy array; {wanted}.") from error
