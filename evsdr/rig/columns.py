"""Read HDF5 files that hold events as four columns x, y, p, t: DSEC, RVT, M3ED.

DSEC (Gehrig et al. 2021): group `events`, times counted from `t_offset`; the sensor's size is not told. RVT (Gehrig and
Scaramuzza 2023) adds `height` and `width`. M3ED (Chaney et al. 2023): group `prophesee/left`, size in `calib/resolution`.
None of them has triggers. Times are microseconds.
"""

from pathlib import Path

import h5py
import numpy as np

from evsdr.errors import InputError
from evsdr.files.hdf5 import member, open_hdf5, read_all
from evsdr.records import Events
from evsdr.rig.camera_file import EVENT_FIELDS, CameraRecording, check_recording, no_edges, read_size

GROUPS = ("events", "prophesee/left", "prophesee/right")
LARGEST_OFFSET = 2**62  # us, so that sums stay in 64 bits


def has_columns(path: Path) -> bool:
    """Tell whether a HDF5 file holds events as columns."""
    with open_hdf5(path, "a camera's HDF5 file") as file:
        return _group(file) is not None


def read_columns(path: str | Path, size: tuple[int, int] | None = None) -> CameraRecording:
    """Read a HDF5 file that holds events as columns.

    Parameters
    ----------
    path : str or Path
        HDF5 file.
    size : (width, height), optional
        Of the sensor; that of the file if None.

    Raises
    ------
    InputError
        The file is damaged, or does not tell the sensor's size.

    Warns
    -----
    InputWarning
        Some events lay outside the sensor, or not in time order.
    """
    path = Path(path)
    with open_hdf5(path, "a camera's HDF5 file") as file:
        group = _group(file)
        if group is None:
            raise InputError("it holds no columns x, y, p, t of events; name another file.")
        columns = {name: _column(group[name]) for name in EVENT_FIELDS}
        if len({len(column) for column in columns.values()}) > 1:
            raise InputError(f"x, y, p and t of {group.name[1:]} differ in length; copy the file again.")
        offset = _whole(member(group, "t_offset"), _whole(member(file, "t_offset"), 0))
        geometry = _geometry(group)
    width, height = size or read_size(path, geometry, "fields do", 65536)
    p, t = columns["p"] > 0, columns["t"].astype(np.int64)
    bad = (columns["x"] < 0) | (columns["x"] > 65535) | (columns["y"] < 0) | (columns["y"] > 65535)
    if bad.any() or abs(offset) > LARGEST_OFFSET or (len(t) and np.abs(t).max() > LARGEST_OFFSET):
        raise InputError(f"{path}: its events are out of any bounds; the file is damaged: copy it again.")
    events = Events(
        columns["x"].astype(np.uint16), columns["y"].astype(np.uint16), p.astype(np.int8), t + offset
    )
    return check_recording(path, CameraRecording(width, height, events, no_edges()))


def _group(file: h5py.File) -> h5py.Group | None:
    groups = (member(file, name) for name in GROUPS)
    return next((g for g in groups if isinstance(g, h5py.Group) and set(EVENT_FIELDS) <= set(g)), None)


def _column(dataset: h5py.Dataset) -> np.ndarray:
    if not isinstance(dataset, h5py.Dataset) or dataset.ndim != 1 or dataset.dtype.kind not in "biu":
        raise InputError(f"{dataset.name[1:]} must be a list of whole numbers; copy the file again.")
    return read_all(dataset)


def _whole(item: object, default: int | None) -> int | None:
    """Give a number that a dataset holds."""
    if not isinstance(item, h5py.Dataset) or item.size != 1 or item.dtype.kind not in "iu":
        return default
    return int(np.ravel(item[()])[0])


def _geometry(group: h5py.Group) -> str:
    resolution = member(group, "calib/resolution")
    if isinstance(resolution, h5py.Dataset) and resolution.size == 2:
        width, height = np.ravel(resolution[()])
    else:
        width, height = (_whole(member(group, name), None) for name in ("width", "height"))
    return f"{width}x{height}"
