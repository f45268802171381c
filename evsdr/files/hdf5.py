"""HDF5 files that others wrote: every fault becomes a sentence, and nothing outside the file is read."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import hdf5plugin  # noqa: F401  (its filters register on import)
import numpy as np

from evsdr.errors import InputError, check_memory
from evsdr.files.child import survives
from evsdr.files.kind import HDF5, other_kind

# Compression by which a declared length is believed; measured: events of all filters shrink to a tenth, zeros to 1 / 1000
MOST_RATIO, SMALL = 5000, 64 << 20  # and bytes that are believed anyway
COPIES = 3  # of a dataset that its checks take
PATIENCE = 30.0  # seconds in which all items of a file are listed; guessed: 15,000 chunks take far below one


@contextmanager
def open_hdf5(path: Path, wanted: str) -> Iterator[h5py.File]:
    """Open a file to read; what goes wrong inside becomes an `InputError` that names the file.

    Parameters
    ----------
    path : Path
    wanted : str
        What to name instead, for sentences: "an events.h5".
    """
    if not path.exists():
        raise InputError(f"{path}: there is no such file; name {wanted}.")
    if not path.is_file() or not h5py.is_hdf5(path):  # a FIFO would be waited for
        no = f"{path}: this is not a readable HDF5 file; name {wanted}."
        raise InputError(other_kind(path, HDF5, wanted) or no)
    damaged = f"{path}: the HDF5 file is damaged or cut short; copy it again."
    if not survives(lambda: _list_items(path), PATIENCE):  # libhdf5 hangs or crashes on some bytes
        raise InputError(damaged)
    try:
        with h5py.File(path, "r") as file:
            yield file
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (
        OSError,
        RuntimeError,
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
    ) as error:  # all that h5py
        raise InputError(damaged) from error  # makes of damage


def _list_items(path: Path) -> None:
    """Read the attributes of all items, and where the chunks of datasets lie."""

    def look(_, item: h5py.HLObject) -> None:
        dict(item.attrs)
        if isinstance(item, h5py.Dataset) and item.chunks:
            item.id.get_num_chunks()

    with h5py.File(path, "r") as file:
        look("/", file)
        file.visititems(look)


def member(group: h5py.Group, name: str) -> h5py.Group | h5py.Dataset | None:
    """Give what lies under a name, or None; a link to another file is refused."""
    item = group
    for part in name.split("/"):
        if not isinstance(item, h5py.Group):
            return None
        link = item.get(part, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise InputError(f"{name} is a link to another file; copy what it means into this one.")
        item = item.get(part)
    return item


def read_all(dataset: h5py.Dataset) -> np.ndarray:
    """Read a dataset whose values lie in its own file, and are not more than that file can hold."""
    check_readable(dataset)
    return dataset[()]


def check_readable(dataset: h5py.Dataset, copies: int = COPIES) -> None:
    """Refuse what `check_storage` refuses, and filters that are not installed."""
    check_storage(dataset, copies)
    properties = dataset.id.get_create_plist()
    for i in range(properties.get_nfilters()):
        code, _, _, filter_name = properties.get_filter(i)
        if not h5py.h5z.filter_avail(code):
            raise InputError(
                f"{dataset.name.lstrip('/')} is compressed by filter {code} ({filter_name.decode(errors='replace')}), "
                "which is not installed here; rewrite it with gzip where it is, for example by h5repack -f GZIP=4."
            )


def check_storage(dataset: h5py.Dataset, copies: int = COPIES) -> None:
    """Refuse a dataset whose values lie in other files, or that declares more than its file can hold, or memory its copies."""
    name = dataset.name.lstrip("/")
    if dataset.external or dataset.is_virtual:
        raise InputError(f"the values of {name} lie in other files; copy them into this one.")
    declared, held = dataset.size * dataset.dtype.itemsize, dataset.file.id.get_filesize()
    if declared > max(MOST_RATIO * held, SMALL):
        raise InputError(
            f"{name} declares {dataset.size} entries, but the file has only {held} bytes; copy it again."
        )
    check_memory(f"{name} of {dataset.size} entries", copies * declared, "cut the recording")
