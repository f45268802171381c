"""Read the recordings that EventPS (Yu et al., CVPR 2024) publishes, and the file of triggers beside each.

Events: xz of float32 records row, column, polarity, seconds. Triggers: float32 seconds, one per turn of the light.
"""

import lzma
from pathlib import Path

import numpy as np

from evsdr.errors import InputError, free_memory
from evsdr.records import Events
from evsdr.rig.camera_file import CameraRecording, check_recording, no_edges, warn

SIZE = 720  # pixels along both sides of the published recordings
COPIES = 4  # of the records while they become events
PIECE = 1 << 24  # bytes that are unpacked at once
LONGEST = 1e6  # seconds of a recording
XZ = b"\xfd7zXZ\x00"


def is_xz(path: Path) -> bool:
    """Tell whether a file starts as xz does."""
    with open(path, "rb") as file:
        return file.read(len(XZ)) == XZ


def unpack(path: Path) -> bytes:
    """Unpack a xz file.

    Raises
    ------
    InputError
        It is damaged, or larger than the memory.
    """
    pieces, most = [], free_memory() / COPIES
    try:
        with lzma.open(path) as file:
            while piece := file.read(PIECE):
                pieces.append(piece)
                most -= len(piece)
                if most < 0:
                    raise InputError(
                        f"{path}: unpacked it is larger than the free memory; cut the recording."
                    )
    except (lzma.LZMAError, EOFError) as error:
        raise InputError(f"{path}: the xz file is damaged or cut short; copy it again.") from error
    return b"".join(pieces)


def read_eventps(path: str | Path, size: tuple[int, int] | None = None) -> CameraRecording:
    """Read events as EventPS publishes them; they have no triggers of their own.

    Parameters
    ----------
    path : str or Path
        xz file.
    size : (width, height), optional
        Of the sensor region, which the file does not tell; 720 x 720 if None.

    Raises
    ------
    InputError
        The file is damaged, or holds something else.

    Warns
    -----
    InputWarning
        The size was taken for granted, or some events lay outside of it or not in time order.
    """
    path = Path(path)
    data = unpack(path)
    if len(data) % 16:
        raise InputError(
            f"{path}: unpacked, its {len(data)} bytes are no records of four float32 (row, column, polarity, seconds); "
            "name the events of an EventPS recording, and their triggers by --triggers."
        )
    row, column, polarity, seconds = np.frombuffer(data, "<f4").reshape(-1, 4).T
    places = np.isfinite(row) & np.isfinite(column) & (row >= 0) & (column >= 0) & (row == np.floor(row))
    places &= (column == np.floor(column)) & (np.maximum(row, column) < 65536)
    right = places & np.isin(polarity, (-1, 0, 1)) & (np.abs(seconds) < LONGEST)
    if not right.all():
        raise InputError(
            f"{path}: record {np.argmin(right)} is no event (row, column, polarity, seconds); name the events of an "
            "EventPS recording, and their triggers by --triggers."
        )
    if size is None:
        warn(
            f"{path}: it does not tell the sensor's size; {SIZE} x {SIZE} is taken, else give --sensor-size."
        )
    width, height = size or (SIZE, SIZE)
    t = np.rint(1e6 * seconds.astype(np.float64)).astype(np.int64)
    events = Events(column.astype(np.uint16), row.astype(np.uint16), (polarity > 0).astype(np.int8), t)
    return check_recording(path, CameraRecording(width, height, events, no_edges()))
