"""Join a camera's recording and the ring's log, with what is known of the sensor."""

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from evsdr.errors import InputError
from evsdr.files.events_h5 import SENSOR_DEFAULTS
from evsdr.records import Recording, Schedule, Sensor
from evsdr.rig.camera_file import CameraRecording, between
from evsdr.rig.log import RingLog
from evsdr.rig.rounds import Edge, Rounds, find_rounds


@dataclass(frozen=True, kw_only=True)
class JoinOptions:
    """How a recording and the ring's log are joined."""

    trigger_edge: Edge = "rising"
    """Edge of a trigger pulse that marks the start of a round; falling for an active-low trigger."""
    trigger_id: int | None = None
    """Trigger input that marks the rounds; by default the one that fits."""
    start_us: float | None = None
    """Start of the first round on the camera's clock [us], for a recording without triggers."""
    crop: tuple[int, int, int, int] | None = None
    """Left, top, width and height of the region to keep; as large as the film of the scene file."""
    sensor_size: tuple[int, int] | None = None
    """Width and height of the sensor, where the file does not tell."""
    thresholds: Path | None = None
    """Calibration file (.npz or .h5) with contrast_threshold_on and contrast_threshold_off, numbers or
    (height, width) arrays, and perhaps refractory_us. The options below win over it."""
    threshold_on: float | None = None
    """Contrast threshold of ON events (natural log)."""
    threshold_off: float | None = None
    """Contrast threshold of OFF events (natural log)."""
    refractory_us: float | None = None
    """Refractory period [us]."""


def join(
    camera: CameraRecording, log: RingLog, known: dict, options: JoinOptions
) -> tuple[Recording, Rounds | None]:
    """Join events and log.

    Parameters
    ----------
    known : dict
        What is known of the sensor, see `read_sensor`.

    Returns
    -------
    recording : Recording
        Events of the complete rounds; unknown values of the sensor are the documented defaults.
    rounds : Rounds or None
        None where --start-us counts the rounds.

    Raises
    ------
    InputError
        They don't belong together; the sentence doesn't name the file.
    """
    slot_us, rounds = log.slot_us, None
    if options.start_us is not None and not np.isfinite(options.start_us):
        raise InputError(
            "--start-us is not a finite number; give the camera's time at the start of the first round."
        )
    if options.start_us is None:
        rounds = find_rounds(camera.edges, log, options.trigger_edge, options.trigger_id)
        begin, end = rounds.start_us[[0, -1]]
        slot_us *= rounds.clock_ratio
    else:
        begin, end = options.start_us, options.start_us + log.n_round * log.round_us
    events = between(camera.events, begin, end)
    if len(events) < 2 or events.p.min() == events.p.max():
        raise InputError(
            f"{len(events)} events lie within the rounds ({1e-6 * begin:.3f} s to {1e-6 * end:.3f} s) and in "
            "the region, not both brighter and darker ones; check --start-us and --crop, and that the camera "
            "sees the ring."
        )
    sensor = Sensor(camera.width, camera.height, **SENSOR_DEFAULTS | known)
    schedule = Schedule(log.order, slot_us, log.crossfade, float(begin))
    return Recording(events, sensor, schedule, rounds.start_us if rounds else np.empty(0, np.int64)), rounds


def read_sensor(options: JoinOptions, size: tuple[int, int]) -> dict[str, float | np.ndarray]:
    """Collect what is known of the sensor.

    Parameters
    ----------
    size : (height, width)
        Of the whole sensor; arrays of this shape are cropped like the events.

    Returns
    -------
    dict
        Fields of `Sensor`; what is not known is missing.

    Raises
    ------
    InputError
        A value can't be used.
    """
    known = _read_thresholds(options.thresholds, size, options.crop) if options.thresholds else {}
    given = {
        "contrast_threshold_on": ("--threshold-on", options.threshold_on),
        "contrast_threshold_off": ("--threshold-off", options.threshold_off),
        "refractory_us": ("--refractory-us", options.refractory_us),
    }
    for name, (option, value) in given.items():
        if value is None:
            continue
        if not (np.isfinite(value) and (value > 0 or (value == 0 and name == "refractory_us"))):
            raise InputError(f"{option} is {value:g}; give the true value, as {SENSOR_DEFAULTS[name]:g}.")
        known[name] = value
    return known


def _read_thresholds(path: Path, size: tuple[int, int], region: tuple[int, ...] | None) -> dict:
    try:
        if h5py.is_hdf5(path):
            with h5py.File(path, "r") as file:
                group = file.get("sensor", file)
                fields = {name: group.attrs[name] for name in SENSOR_DEFAULTS if name in group.attrs}
                fields |= {name: group[name][()] for name in SENSOR_DEFAULTS if name in group}
        else:
            with np.load(path) as file:
                fields = {name: file[name] for name in SENSOR_DEFAULTS if name in file}
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        raise InputError(
            f"{path}: this is no readable .npz or .h5 file; name a calibration of thresholds."
        ) from error
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
        least = value.min() if np.isfinite(value).all() else -np.inf
        if least < 0 or (least == 0 and name != "refractory_us"):
            raise InputError(f"{path}: {name} has values that are not above 0; put the median there.")
        if value.shape == size:
            value = value[top : top + height, left : left + width]
        known[name] = value.astype(np.float32) if value.ndim else float(value)
    return known
