"""Join a camera's recording and the ring's log, with what is known of the sensor."""

from pathlib import Path
from typing import Literal

import h5py
import numpy as np

from evsdr.errors import InputError
from evsdr.files.arrays import read_npz
from evsdr.files.atomic import atomic_path
from evsdr.files.events_h5 import SENSOR_DEFAULTS, TOLERANCE, write_recording
from evsdr.files.hdf5 import member, open_hdf5, read_all
from evsdr.records import Recording, Schedule, Sensor
from evsdr.rig.camera_file import CameraRecording, between
from evsdr.rig.log import RingLog
from evsdr.rig.rounds import Edge, Rounds, find_rounds

Lamp = Literal["ring", "own"]


def join(
    camera: CameraRecording,
    log: RingLog,
    known: dict[str, float | np.ndarray],
    trigger_edge: Edge = "rising",
    trigger_id: int | None = None,
    start_us: float | None = None,
    lamp: Lamp = "ring",
) -> tuple[Recording, Rounds | None]:
    """Join events and log.

    Parameters
    ----------
    camera : CameraRecording
    log : RingLog
    known : dict
        What is known of the sensor, see `read_sensor`.
    trigger_edge : str
        Edge of a trigger pulse that marks the start of a round, `rising` or `falling`.
    trigger_id : int, optional
        Trigger input that marks the rounds; by default the one that fits.
    start_us : float, optional
        Start of the first round on the camera's clock [us], instead of triggers.
    lamp : str
        Who switches the constant light: the `ring`, whose log tells of it, or `own`, of which nobody tells.

    Returns
    -------
    recording : Recording
        Events of the complete rounds; unknown values of the sensor are the documented defaults.
    rounds : Rounds or None
        None where `start_us` counts the rounds.

    Raises
    ------
    InputError
        They don't belong together; the sentence doesn't name the file.
    """
    slot_us, rounds = log.slot_us, None
    if start_us is not None and not np.isfinite(start_us):
        raise InputError(
            "--start-us is not a finite number; give the camera's time at the start of the first round."
        )
    if start_us is None:
        rounds = find_rounds(camera.edges, log, trigger_edge, trigger_id)
        begin, end = rounds.start_us[[0, -1]]
        slot_us *= rounds.clock_ratio
    else:
        begin, end = start_us, start_us + log.n_round * log.round_us
    events = between(camera.events, begin, end)
    if len(events) < 2 or events.p.min() == events.p.max():
        raise InputError(
            f"{len(events)} events lie within the rounds ({1e-6 * begin:.3f} s to {1e-6 * end:.3f} s) and in "
            "the region, not both brighter and darker ones; check --start-us and --crop, and that the camera "
            "sees the ring."
        )
    sensor = Sensor(camera.width, camera.height, **SENSOR_DEFAULTS | known)
    lit = log.constant_light if lamp == "ring" else None
    schedule = Schedule(log.order, slot_us, log.crossfade, float(begin), log.trim, lit)
    return Recording(events, sensor, schedule, rounds.start_us if rounds else np.empty(0, np.int64)), rounds


def read_sensor(
    size: tuple[int, int],
    crop: tuple[int, int, int, int] | None = None,
    thresholds: Path | None = None,
    threshold_on: float | None = None,
    threshold_off: float | None = None,
    refractory_us: float | None = None,
) -> dict[str, float | np.ndarray]:
    """Collect what is known of the sensor.

    Parameters
    ----------
    size : (height, width)
        Of the whole sensor; arrays of this shape are cropped like the events.
    crop : (left, top, width, height), optional
        Region that is kept.
    thresholds : Path, optional
        Calibration file (.npz or .h5) with fields of `Sensor`.
    threshold_on, threshold_off, refractory_us : float, optional
        Win over that file.

    Returns
    -------
    dict
        Fields of `Sensor`; what is not known is missing.

    Raises
    ------
    InputError
        A value can't be used.
    """
    known = _read_thresholds(thresholds, size, crop) if thresholds else {}
    given = {
        "contrast_threshold_on": ("--threshold-on", threshold_on),
        "contrast_threshold_off": ("--threshold-off", threshold_off),
        "refractory_us": ("--refractory-us", refractory_us),
    }
    for name, (option, value) in given.items():
        if value is None:
            continue
        if not (np.isfinite(value) and (value > 0 or (value == 0 and name == "refractory_us"))):
            raise InputError(f"{option} is {value:g}; give the true value, as {SENSOR_DEFAULTS[name]:g}.")
        known[name] = value
    return known


def _read_thresholds(path: Path, size: tuple[int, int], region: tuple[int, ...] | None) -> dict:
    wanted = "a calibration of thresholds"
    try:
        if h5py.is_hdf5(path):
            with open_hdf5(path, wanted) as file:
                fields = read_sensor_values(file)
        else:
            fields = read_npz(path, SENSOR_DEFAULTS, f"name {wanted}")
    except (InputError, OSError) as error:
        raise InputError(f"{path}: this is no readable .npz or .h5 file; name {wanted}.") from error
    if not fields:
        raise InputError(
            f"{path}: it holds none of {', '.join(SENSOR_DEFAULTS)}; name a calibration of thresholds."
        )
    left, top, width, height = region or (0, 0, size[1], size[0])
    known = {}
    for name, value in fields.items():
        value = np.asarray(value)
        shapes = [(), size, (height, width)] if name != "refractory_us" else [()]
        if value.shape not in shapes or value.dtype.kind not in "fiu":
            raise InputError(
                f"{path}: {name} must be a number or an array of (height, width) = {size}; write it so."
            )
        with np.errstate(over="ignore"):
            value = value.astype(np.float32) if value.ndim else value
        least = value.min() if np.isfinite(value).all() else -np.inf
        if least < 0 or (least == 0 and name != "refractory_us"):
            raise InputError(f"{path}: {name} has values that are not above 0; put the median there.")
        if value.shape == size:
            value = value[top : top + height, left : left + width]
        known[name] = value if value.ndim else float(value)
    return known


def read_sensor_values(file: h5py.File) -> dict[str, np.ndarray]:
    """Read what a file tells of a sensor, from its group `sensor` or its root; arrays win over attributes."""
    group = member(file, "sensor") or file
    fields = {name: group.attrs[name] for name in (*SENSOR_DEFAULTS, TOLERANCE) if name in group.attrs}
    held = {name: member(group, name) for name in SENSOR_DEFAULTS}
    return fields | {name: read_all(item) for name, item in held.items() if isinstance(item, h5py.Dataset)}


def write_joined(path: Path, recording: Recording, known: dict[str, float | np.ndarray]) -> None:
    """Write events.h5 without the sensor values that are not known, so that its reader warns of them."""
    with atomic_path(path) as temporary:
        write_recording(temporary, recording)
        with h5py.File(temporary, "r+") as file:
            for name in SENSOR_DEFAULTS.keys() - known:
                del file["sensor"].attrs[name]
