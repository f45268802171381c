"""Read AEDAT4 files of iniVation's cameras, by the package `aedat`."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.child import survives
from evsdr.records import Events
from evsdr.rig.camera_file import CameraRecording, Edges, check_recording, no_edges

PATIENCE, SLOWEST = 10.0, 5e6  # seconds, and bytes per second, in which a whole file is read; guessed
START = b"#!AER-DAT4"
# What the package tells of a trigger: polarity and input. Edges of the external signal, its pulses, the generator's edges.
SOURCES = {1: (1, 0), 2: (0, 0), 3: (1, 0), 4: (1, 1), 5: (0, 1)}


def is_aedat(path: Path) -> bool:
    """Tell whether a file starts as AEDAT4 does."""
    with open(path, "rb") as file:
        return file.read(len(START)) == START


def read_aedat(path: str | Path, size: tuple[int, int] | None = None) -> CameraRecording:
    """Read an AEDAT4 file with its triggers; of several streams of events the first.

    Parameters
    ----------
    path : str or Path
        AEDAT4 file.
    size : (width, height), optional
        Of the sensor; that of the file if None.

    Raises
    ------
    InputError
        The package is not installed, or the file is damaged or holds no events.

    Warns
    -----
    InputWarning
        Some events lay outside the sensor, or not in time order.
    """
    path = Path(path)
    try:
        import aedat
    except ImportError:
        raise InputError(
            f"{path}: AEDAT4 is read by a package that is not installed; run pip install 'evsdr[aedat]'."
        ) from None
    with _panics_as_errors(path):
        if not survives(lambda: list(aedat.Decoder(path)), PATIENCE + path.stat().st_size / SLOWEST):
            raise ValueError("it crashes or hangs")  # as damaged lengths do
        decoder = aedat.Decoder(path)
        streams = decoder.id_to_stream()
        chosen = next((i for i in sorted(streams) if streams[i]["type"] == "events"), None)
        packets = list(decoder)
    table = [packet["events"] for packet in packets if packet["stream_id"] == chosen]
    if not table:
        raise InputError(f"{path}: it holds no events; record again with the lens open and the ring on.")
    width, height = size or (streams[chosen]["width"], streams[chosen]["height"])
    t, x, y, on = (np.concatenate([part[name] for part in table]) for name in ("t", "x", "y", "on"))
    events = Events(x, y, on.astype(np.int8), t.astype(np.int64))
    edges = _edges([packet["triggers"] for packet in packets if "triggers" in packet])
    return check_recording(path, CameraRecording(width, height, events, edges))


def _edges(packets: list[np.ndarray]) -> Edges:
    if not packets:
        return no_edges()
    t, source = (np.concatenate([part[name] for part in packets]) for name in ("t", "source"))
    known = np.isin(source, list(SOURCES))
    told = np.array([SOURCES[number] for number in source[known].tolist()]).reshape(-1, 2)
    return Edges(told[:, 0].astype(np.int8), t[known].astype(np.int64), told[:, 1].astype(np.int16))


@contextmanager
def _panics_as_errors(path: Path) -> Iterator[None]:
    """Make an `InputError` of what the package makes of damage: exceptions, and panics, which also print."""
    sys.stderr.flush()
    kept = os.dup(2)
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # a panic is no Exception
        raise InputError(f"{path}: the AEDAT4 file is damaged or cut short; copy it again.") from error
    finally:
        os.dup2(kept, 2)
        os.close(kept)
