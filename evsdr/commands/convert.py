"""`python -m evsdr.convert recording.raw --ring ring.json`: join a camera's recording and the ring's log.

The result is an events.h5 as `evsdr.files.events_h5` reads it: the events of the complete rounds, their starts on
the camera's clock, the sensor and the schedule.
"""

from dataclasses import dataclass
from pathlib import Path

import h5py
import tyro

from evsdr.commands.console import print_table, run_command
from evsdr.errors import InputError
from evsdr.files.atomic import atomic_path
from evsdr.files.events_h5 import SENSOR_DEFAULTS, write_recording
from evsdr.progress import Stages
from evsdr.records import Recording
from evsdr.rig import health
from evsdr.rig.camera_file import CameraRecording, crop
from evsdr.rig.join import JoinOptions, join, read_sensor
from evsdr.rig.log import RingLog, read_ring_log
from evsdr.rig.metavision import read_hdf5
from evsdr.rig.raw import is_raw, read_raw


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


def write(path: Path, recording: Recording, known: dict) -> None:
    """Write events.h5 without the sensor values that are not known, so that its reader warns of them."""
    with atomic_path(path) as temporary:
        write_recording(temporary, recording)
        with h5py.File(temporary, "r+") as file:
            for name in SENSOR_DEFAULTS.keys() - known:
                del file["sensor"].attrs[name]
