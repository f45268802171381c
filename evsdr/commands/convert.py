"""`python -m evsdr.convert recording.raw --ring ring.json`: join a camera's recording and the ring's log.

The result is an events.h5 as `evsdr.files.events_h5` reads it: the events of the complete rounds, their starts on
the camera's clock, the sensor and the schedule.
"""

from dataclasses import dataclass
from pathlib import Path

import tyro

from evsdr.commands.console import print_table, run_command
from evsdr.errors import InputError
from evsdr.progress import Stages
from evsdr.rig.join import Lamp
from evsdr.rig.rounds import Edge


@dataclass(frozen=True, kw_only=True)
class JoinOptions:
    """How a recording and the ring's log are joined."""

    trigger_edge: Edge = "rising"
    """Edge of a trigger pulse that marks the start of a round; falling for an active-low trigger."""
    trigger_id: int | None = None
    """Trigger input that marks the rounds; by default the one that fits."""
    start_us: float | None = None
    """Start of the first round on the camera's clock [us], for a recording without triggers."""
    lamp: Lamp = "ring"
    """What gives the constant light: the ring, whose log tells whether it was on, or a lamp of your own, of which
    it tells nothing."""
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
    join_files(options.recording, options.ring, out, options)


def join_files(path: Path, log_path: Path, out: Path, options: JoinOptions) -> None:
    """Join a recording and the ring's log, write events.h5, print a table and hints."""
    from evsdr.rig import health
    from evsdr.rig.camera_file import crop
    from evsdr.rig.join import join, read_sensor, write_joined
    from evsdr.rig.log import read_ring_log
    from evsdr.rig.reader import read_camera_file

    log = read_ring_log(log_path)
    with Stages("convert") as stages:
        with stages.stage("read recording"):
            camera = read_camera_file(path, options.sensor_size)
            size = (camera.height, camera.width)
            if options.crop:
                camera = crop(camera, *options.crop)
        known = read_sensor(
            size,
            options.crop,
            options.thresholds,
            options.threshold_on,
            options.threshold_off,
            options.refractory_us,
        )
        with stages.stage("join"):
            try:
                recording, rounds = join(
                    camera,
                    log,
                    known,
                    options.trigger_edge,
                    options.trigger_id,
                    options.start_us,
                    options.lamp,
                )
            except InputError as error:
                raise InputError(f"{path}: {error}") from error
        with stages.stage("write"):
            write_joined(out, recording, known)
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
