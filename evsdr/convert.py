"""`python -m evsdr.convert recording.raw --ring ring.json`: join a camera's recording and the ring's log.

The result is an events.h5 as `evsdr.recording` reads it: the events of the complete rounds, their starts on
the camera's clock, the sensor and the schedule.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import tyro

from evsdr import health
from evsdr.camera_recording import CameraRecording, between, crop
from evsdr.console import Stages, print_table, run_command
from evsdr.errors import InputError
from evsdr.files import atomic_path
from evsdr.metavision_hdf5 import read_hdf5
from evsdr.raw import is_raw, read_raw
from evsdr.recording import SENSOR_DEFAULTS, write_recording
from evsdr.records import Recording, Schedule, Sensor
from evsdr.ring_log import RingLog, read_ring_log
from evsdr.rounds import Edge, Rounds, find_rounds


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


@dataclass(frozen=True, kw_only=True)
class Options(JoinOptions):
    """Join a camera's recording (RAW or HDF5) and the ring's log into events.h5."""

    recording: tyro.conf.Positional[Path]
    """RAW (EVT2, EVT2.1, EVT3) or HDF5 file of the camera."""
    ring: Path
    """Log of the ring, ring.json."""
    out: Path | None = None
    """File to write; by default events.h5 beside the recording."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("convert", Options, command, argv)


def command(options: Options) -> None:
    """Join, write, print what came out."""
    out = options.out or options.recording.with_name("events.h5")
    if out.resolve() == options.recording.resolve():
        raise InputError(f"{out}: this is the recording itself; give another file by --out.")
    convert(options.recording, read_ring_log(options.ring), out, options)


def convert(path: Path, log: RingLog, out: Path, options: JoinOptions) -> None:
    """Join a recording and the ring's log, write events.h5, print a table and hints.

    Parameters
    ----------
    path : Path
        The camera's recording.
    log : RingLog
        What the ring did.
    out : Path
        File to write.
    options : JoinOptions
        As on the command line.

    Raises
    ------
    InputError
        Something given can't be used; then nothing is written.
    """
    with Stages("convert") as stages:
        with stages.stage("read recording"):
            camera = read_camera_file(path, options.sensor_size)
            size = (camera.height, camera.width)
            if options.crop:
                camera = crop(camera, *options.crop)
        known = read_sensor(options, size)
        with stages.stage("join"):
            try:
                recording, rounds = join(camera, log, known, options)
            except InputError as error:
                raise InputError(f"{path}: {error}") from error
        with stages.stage("write"):
            write(out, recording, known)
    n_round = len(rounds) if rounds else log.n_round
    begin = rounds.start_us[0] if rounds else recording.schedule.start_us
    figures = health.examine(
        recording, n_round, begin, begin + n_round * len(log.order) * recording.schedule.slot_us
    )
    rows = health.rows(figures)
    rows += [("events outside the rounds", f"{len(camera.events) - len(recording.events):,}")]
    if rounds:
        rows += [
            ("trigger input", f"{rounds.trigger_id}"),
            ("jitter of the rounds", f"{rounds.jitter_us:.0f} us"),
            ("camera's clock / ring's clock", f"{rounds.clock_ratio:.6f}"),
        ]
    rows += [("seconds", f"{sum(stages.seconds.values()):.2f}")]
    print_table(str(out), rows)
    for hint in health.hints(figures, recording) or ["Nothing stands out against this recording."]:
        print(hint)


def read_camera_file(path: Path, size: tuple[int, int] | None = None) -> CameraRecording:
    """Read a RAW or HDF5 file.

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


def write(path: Path, recording: Recording, known: dict) -> None:
    """Write events.h5 without the sensor values that are not known, so that its reader warns of them."""
    with atomic_path(path) as temporary:
        write_recording(temporary, recording)
        with h5py.File(temporary, "r+") as file:
            for name in SENSOR_DEFAULTS.keys() - known:
                del file["sensor"].attrs[name]


if __name__ == "__main__":
    sys.exit(main())
