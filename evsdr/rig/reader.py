"""Read a camera's file of either kind."""

from pathlib import Path

import h5py

from evsdr.errors import InputError
from evsdr.rig.camera_file import CameraRecording
from evsdr.rig.metavision import read_hdf5
from evsdr.rig.raw import is_raw, read_raw


def read_camera_file(path: Path, size: tuple[int, int] | None = None) -> CameraRecording:
    """Read a RAW or HDF5 file.

    Parameters
    ----------
    path : Path
        The camera's recording.
    size : (width, height), optional
        Of the sensor, where the file does not tell.

    Raises
    ------
    InputError
        There is no such file, or it is neither.
    """
    if size and not all(0 < number <= 65536 for number in size):
        raise InputError(f"--sensor-size {size[0]} {size[1]} is no size; give width and height in pixels.")
    try:
        if not path.is_file():
            raise InputError(f"{path}: there is no such file; name the camera's recording.")
        if h5py.is_hdf5(path):
            return read_hdf5(path, size)
        if not is_raw(path):
            raise InputError(f"{path}: this is neither a RAW nor a HDF5 file of a camera; name one.")
        return read_raw(path, size)
    except OSError as error:
        raise InputError(f"{path}: it can't be read ({error.strerror or error}); copy it again.") from error
