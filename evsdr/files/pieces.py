"""Lists of records in HDF5 files, piece by piece, several at a time: memory holds few of them."""

import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import h5py
import numpy as np

from evsdr.threads import side_by_side

PIECE = 1 << 16  # records of a piece at least
PLAIN = [h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE]  # filters that are undone here


def for_pieces(dataset: h5py.Dataset, work: Callable[[int, dict[str, np.ndarray]], None]) -> None:
    """Call work(begin, columns) for each piece of a list of records.

    HDF5 itself undoes one chunk after another; shuffled and deflated ones, the usual case, are undone here by several threads.

    Parameters
    ----------
    dataset : h5py.Dataset
        (n,) records; checked by `hdf5.check_storage` before.
    work : callable
        Given where a piece begins, and its fields by name. Several are called at a time; of what they raise the first in order
        comes out.
    """
    n, (chunk,) = len(dataset), dataset.chunks or (PIECE,)
    plain = dataset.chunks is not None and _filters(dataset) == PLAIN and dataset.dtype.names is not None
    piece = chunk if plain and chunk >= PIECE else -(-PIECE // chunk) * chunk

    def take(begin: int) -> None:
        count = min(piece, n - begin)
        columns = _unpacked(dataset, begin, count) if plain and piece == chunk else None
        if columns is None:
            table = dataset[begin : begin + count]
            columns = {name: table[name] for name in table.dtype.names}
        work(begin, columns)

    with ThreadPoolExecutor(side_by_side()) as threads:
        for _ in threads.map(take, range(0, n, piece)):
            pass


def _filters(dataset: h5py.Dataset) -> list[int]:
    properties = dataset.id.get_create_plist()
    return [properties.get_filter(i)[0] for i in range(properties.get_nfilters())]


def _unpacked(dataset: h5py.Dataset, begin: int, count: int) -> dict[str, np.ndarray] | None:
    """Undo deflation and shuffle of a chunk; None where it is stored otherwise."""
    if not dataset.id.get_chunk_info_by_coord((begin,)).size:
        return None
    left_out, data = dataset.id.read_direct_chunk((begin,))
    if left_out:
        return None
    dtype, n_byte = dataset.dtype, dataset.chunks[0] * dataset.dtype.itemsize
    try:
        data = zlib.decompressobj().decompress(data, n_byte)
    except zlib.error as error:
        raise OSError(f"chunk {begin}: {error}") from error
    if len(data) != n_byte:
        raise OSError(f"chunk {begin} ends early")
    shuffled = np.frombuffer(data, np.uint8).reshape(dtype.itemsize, -1)[
        :, :count
    ]  # byte after byte of all records
    columns = {name: np.empty(count, kind) for name, (kind, *_) in dtype.fields.items()}
    for name, (kind, offset, *_) in dtype.fields.items():
        out = columns[name].view(np.uint8).reshape(count, kind.itemsize)
        for k in range(kind.itemsize):
            out[:, k] = shuffled[offset + k]
    return columns
