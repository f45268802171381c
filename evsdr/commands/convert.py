"""`python -m evsdr.convert recording.raw --ring ring.json`: join a camera's recording and the ring's log.

Without a log the ring is told by options; with too few of them you are told what the recording holds.

The result is an events.h5 as `evsdr.files.events_h5` reads it: the events of the complete rounds, their starts on
the camera's clock, the sensor and the schedule.
"""

from dataclasses import dataclass
from pathlib import Path

import tyro

from evsdr.commands.console import print_table, run_command
from evsdr.errors import InputError, check_range
from evsdr.files.events_h5 import LARGEST_LED
from evsdr.progress import Stages
from evsdr.records import Recording
from evsdr.rig.camera_file import CameraRecording
from evsdr.rig.join import Lamp
from evsdr.rig.log import RingLog
from evsdr.rig.rounds import Edge, Rounds
from evsdr.rig.told import ToldRing, complete


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
    """Join a camera's recording and the ring's log into events.h5. Without --ring and --order you are told what the
    recording holds."""

    recording: tyro.conf.Positional[Path]
    """Recording: RAW (EVT2, EVT2.1, EVT3), HDF5 (Metavision, DSEC, RVT, M3ED, events.h5), xz of EventPS, or AEDAT4."""
    ring: Path | None = None
    """Log of the ring, ring.json; without one, tell of the ring by the options below."""
    order: tuple[int, ...] | None = None
    """LED of each slot of a round, -1 for none."""
    n_led: int | None = None
    """Number of LEDs that are lit in turn, instead of --order."""
    slot_us: float | None = None
    """Length of a slot [us]; by default what the triggers tell, one at the start of each round."""
    crossfade: float | None = None
    """Fraction of a slot's end over which an LED fades into the next, 1 by default; 0 is a hard switch."""
    rounds: int | None = None
    """Rounds of the ring; by default all that the recording holds."""
    triggers: Path | None = None
    """File of triggers beside the recording: a time [us] in each line, or float32 seconds as EventPS has them."""
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
    join_files(options.recording, ring_of(options), out, options, options.triggers)


def ring_of(options: Options) -> Path | ToldRing | None:
    """Give the log of the ring, or what is told of it; None if that is nothing."""
    told = {"crossfade": options.crossfade, "slot_us": options.slot_us, "n_round": options.rounds}
    told = {name: value for name, value in told.items() if value is not None}
    if options.ring:
        if told or options.order or options.n_led is not None:
            raise InputError(
                "--ring tells order, slots, crossfade and rounds; leave out the options that do so too."
            )
        return options.ring
    if options.order and options.n_led is not None:
        raise InputError("--order and --n-led tell the same; give one of them.")
    if options.n_led is not None:
        check_range("--n-led", options.n_led, 2, LARGEST_LED + 1)
    order = options.order or tuple(range(options.n_led or 0))
    return ToldRing(order, **told) if order else None


def join_files(
    path: Path, ring: Path | ToldRing | None, out: Path, options: JoinOptions, triggers: Path | None = None
) -> None:
    """Join a recording and the ring's log, or what is told of it, write events.h5, print a table and hints."""
    from evsdr.rig.camera_file import crop
    from evsdr.rig.join import join, read_sensor, write_joined
    from evsdr.rig.log import read_ring_log
    from evsdr.rig.reader import read_camera_file

    log = read_ring_log(ring) if isinstance(ring, Path) else None
    with Stages("convert", ("read recording", "join", "write")) as stages:
        with stages.stage("read recording"):
            camera = read_camera_file(path, options.sensor_size, triggers)
            if ring is None:
                refuse(path, camera)
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
            marks = options.trigger_edge, options.trigger_id, options.start_us
            try:
                log = log or complete(ring, camera, *marks)
                recording, rounds = join(camera, log, known, *marks, options.lamp)
            except InputError as error:
                raise InputError(f"{path}: {error}") from error
        with stages.stage("write"):
            write_joined(out, recording, known)
    report(out, camera, recording, log, rounds, sum(stages.seconds.values()))


def refuse(path: Path, camera: CameraRecording) -> None:
    """Print what a recording holds, and say what else must be told."""
    from evsdr.files.kind import kind_of
    from evsdr.rig import contents

    print_table(str(path), [("file", kind_of(path)), *contents.rows(camera)])
    slots = "" if len(camera.edges) else ", --slot-us and --start-us, as it has no triggers"
    raise InputError(
        f"{path}: it does not tell how the ring ran; give its ring.json by --ring, or --order or --n-led{slots}."
    )


def report(
    out: Path,
    camera: CameraRecording,
    recording: Recording,
    log: RingLog,
    rounds: Rounds | None,
    seconds: float,
) -> None:
    """Print what came out, and hints on how to record better."""
    from evsdr.rig import health

    n_round = len(rounds) if rounds else log.n_round
    begin = rounds.start_us[0] if rounds else recording.schedule.start_us
    figures = health.examine(
        recording, n_round, begin, begin + n_round * len(log.order) * recording.schedule.slot_us
    )
    schedule = recording.schedule
    slots = f"{len(schedule.order)} slots of {schedule.slot_us:.6g} us, crossfade {schedule.crossfade:g}"
    rows = [*health.rows(figures), ("round", slots)]
    rows.append(("events outside the rounds", f"{len(camera.events) - len(recording.events):,}"))
    if rounds:
        rows += [
            ("trigger input", f"{rounds.trigger_id}"),
            ("jitter of the rounds", f"{rounds.jitter_us:.0f} us"),
            ("camera's clock / ring's clock", f"{rounds.clock_ratio:.6f}"),
        ]
    rows.append(("seconds", f"{seconds:.2f}"))
    print_table(str(out), rows)
    for hint in health.hints(figures, recording) or ["Nothing stands out against this recording."]:
        print(hint)
