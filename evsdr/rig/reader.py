"""Read a recording of any kind; its content tells the kind, not its name."""

from dataclasses import replace
from pathlib import Path

import h5py

from evsdr.errors import InputError
from evsdr.rig.aedat import is_aedat, read_aedat
from evsdr.rig.camera_file import CameraRecording
from evsdr.rig.columns import has_columns, read_columns
from evsdr.rig.eventps import is_xz, read_eventps
from evsdr.rig.metavision import read_hdf5
from evsdr.rig.raw import is_raw, read_raw
from evsdr.rig.side_triggers import read_triggers


def read_camera_file(
    path: str | Path, size: tuple[int, int] | None = None, triggers: str | Path | None = None
) -> CameraRecording:
    """Read the events and triggers of a file: RAW, Metavision HDF5, events.h5, DSEC, RVT, M3ED, EventPS, AEDAT4.

    Parameters
    ----------
    path : str or Path
        The recording.
    size : (width, height), optional
        Of the sensor, where the file does not tell.
    triggers : str or Path, optional
        A file of triggers beside it, which wins over triggers within, see `evsdr.rig.side_triggers`.

    Raises
    ------
    InputError
        There is no such file, or it is damaged or of another kind.

    Warns
    -----
    InputWarning
        Some events lay outside the sensor, or not in time order; or what the file does not tell is taken for granted.
    """
    path = Path(path)
    if size and not all(0 < number <= 65536 for number in size):
        raise InputError(f"--sensor-size {size[0]} {size[1]} is no size; give width and height in pixels.")
    try:
        if not path.is_file():
            raise InputError(f"{path}: there is no such file; name the camera's recording.")
        recording = _reader(path)(path, size)
    except OSError as error:
        raise InputError(f"{path}: it can't be read ({error.strerror or error}); copy it again.") from error
    return replace(recording, edges=read_triggers(Path(triggers))) if triggers else recording


def _reader(path: Path):
    """Give what reads a file, by its content."""
    if h5py.is_hdf5(path):
        return read_columns if has_columns(path) else read_hdf5
    for is_kind, read in ((is_raw, read_raw), (is_xz, read_eventps), (is_aedat, read_aedat)):
        if is_kind(path):
            return read
    raise InputError(
        f"{path}: this is neither a RAW nor a HDF5 file of a camera, nor a recording of EventPS or AEDAT4; name one."
    )
