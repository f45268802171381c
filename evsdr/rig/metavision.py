"""Read a camera's HDF5 files: Metavision's, whose events are packed by ECF, and the same with other filters.

`CD/events` (x, y, p, t) and `EXT_TRIGGER/events` (p, t, id); the sensor's size in the attribute `geometry`
("1280x720"), or in `width` and `height`. The chunks of ECF are taken out as stored and decoded here, as no
package brings this filter.
"""

from pathlib import Path

import h5py
import numpy as np

from evsdr.errors import InputError
from evsdr.files.events_h5 import EVENT_DTYPE
from evsdr.files.hdf5 import check_storage, member, open_hdf5
from evsdr.records import Events
from evsdr.rig import ecf
from evsdr.rig.camera_file import (
    EDGE_FIELDS,
    EVENT_FIELDS,
    CameraRecording,
    Edges,
    check_recording,
    no_edges,
    read_size,
)


def read_hdf5(path: str | Path, size: tuple[int, int] | None = None) -> CameraRecording:
    """Read a HDF5 file of a camera.

    Parameters
    ----------
    path : str or Path
        HDF5 file.
    size : (width, height), optional
        Of the sensor; that of the file if None.

    Raises
    ------
    InputError
        The file is no HDF5 file, of another layout, or damaged.

    Warns
    -----
    InputWarning
        Some events lay outside the sensor, or not in time order.
    """
    path = Path(path)
    with open_hdf5(path, "a camera's HDF5 file") as file:
        geometry = _geometry(file)
        events = Events(*_read_fields(file, "CD/events", EVENT_FIELDS))
        edges = no_edges()
        if member(file, "EXT_TRIGGER/events") is not None:
            edges = Edges(*_read_fields(file, "EXT_TRIGGER/events", EDGE_FIELDS))
    width, height = size or read_size(path, geometry, "attributes do", 65536)
    return check_recording(path, CameraRecording(width, height, events, edges))


def _geometry(file: h5py.File) -> str:
    text = file.attrs.get("geometry", f"{file.attrs.get('width')}x{file.attrs.get('height')}")
    return text.decode("latin-1") if isinstance(text, bytes) else str(text)  # bytes where of fixed length


def _read_fields(file: h5py.File, name: str, kinds: dict[str, type]) -> list[np.ndarray]:
    """Read a list of records; give its fields as arrays of these types, `p` 0 or 1."""
    dataset = member(file, name)
    dtype = getattr(dataset, "dtype", np.dtype("i4"))
    if not isinstance(dataset, h5py.Dataset) or dataset.ndim != 1 or not set(kinds) <= set(dtype.names or ()):
        raise InputError(
            f"it lacks {name}, a list of records {', '.join(kinds)}; export the recording as "
            "Metavision HDF5, or name its RAW file."
        )
    check_storage(dataset)
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(i)[0] for i in range(properties.get_nfilters())]
    if filters == [ecf.FILTER] and dtype == EVENT_DTYPE:
        columns = _read_ecf(dataset)
    else:
        missing = [code for code in filters if not h5py.h5z.filter_avail(code)]
        if missing:
            raise InputError(
                f"{name} is compressed by filter {missing[0]}, which can't be read here; "
                "name the RAW file instead."
            )
        table = dataset[()]
        columns = {field: table[field] for field in kinds}
    if any(column.dtype.kind not in "biu" for column in columns.values()):
        raise InputError(f"{name} must hold whole numbers; export the recording again.")
    bad = (columns["p"] != 0) & (columns["p"] != 1)
    for field in {"x", "y"} & set(kinds):  # what does not fit into 16 bits would come out inside
        bad |= (columns[field] < 0) | (columns[field] > 65535)
    if bad.any():
        raise InputError(f"entry {bad.argmax()} of {name} is no event; the file is damaged: copy it again.")
    return [columns[field].astype(kind, copy=False) for field, kind in kinds.items()]


def _read_ecf(dataset: h5py.Dataset) -> dict[str, np.ndarray]:
    """Decode the chunks of a dataset one by one."""
    n, room = len(dataset), dataset.chunks[0]
    columns, chunk = (
        {field: np.empty(size, kind) for field, kind in EVENT_FIELDS.items()}
        for size in (n, room + ecf.SPARE)
    )
    for start in range(0, n, room):
        left_out, data = dataset.id.read_direct_chunk((start,))
        count = min(room, n - start)
        if left_out:  # this chunk was stored unpacked
            part = np.frombuffer(data, EVENT_DTYPE)
            decoded = len(part)
        else:
            decoded, part = ecf.decode_chunk(data, *chunk.values()), chunk
        if decoded < count:
            raise InputError(f"its events are damaged from number {start} on; copy the file again.")
        for field, column in columns.items():
            column[start : start + count] = part[field][:count]
    return columns
