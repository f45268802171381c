"""`python -m evsdr.capture --port /dev/ttyACM0 --out DIR`: record the ring with a camera, join both.

The camera records before the ring starts and until after it ends. DIR gets the camera's recording (with the
vendor's SDK), ring.json and events.h5. Whatever goes wrong, the ring ends dark.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from evsdr.commands.console import run_command
from evsdr.commands.convert import convert
from evsdr.commands.ring import write_log
from evsdr.errors import InputError, check_range
from evsdr.files.atomic import check_folder
from evsdr.progress import Stages
from evsdr.rig.camera import Camera, Control, open_camera
from evsdr.rig.driver import N_LED, Ring, RingSettings, find_port
from evsdr.rig.join import JoinOptions
from evsdr.rig.log import read_ring_log

POLL_S = 0.1


@dataclass(frozen=True, kw_only=True)
class Options(JoinOptions):
    """Run the ring of LEDs while a camera records, and join both into events.h5."""

    out: Path
    """Folder for ring.json, events.h5 and the camera's recording."""
    port: str | None = None
    """Serial port of the ring; by default the only Arduino that is plugged in."""
    order: tuple[int, ...] = tuple(range(N_LED))
    """LED of each slot of a round, -1 for none."""
    slot_us: float = 20_000.0
    """Length of a slot [us], 200 to 1,000,000."""
    crossfade: float = 1.0
    """Fraction of a slot's end over which an LED fades into the next; 0 is a hard switch."""
    rounds: int = 6
    """Rounds of the ring."""
    trim: tuple[float, ...] = (1.0,) * N_LED
    """Brightness of each LED, 0 to 1."""
    constant_light: bool = False
    """Switch on the constant light of the ring."""
    sync_slots: bool = False
    """Give an edge at each slot on the second trigger output."""
    camera: Control = "auto"
    """Who starts and stops the camera: the vendor's SDK, or you by hand; auto takes the SDK where it is
    installed."""
    serial: str = ""
    """Serial number of the camera; the first one if empty."""
    recording: Path | None = None
    """File that your own camera software writes; it is awaited instead of asked for."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("capture", Options, command, argv)


def command(options: Options) -> None:
    """Record, join, print what came out."""
    camera = open_camera(options.camera, options.recording, options.serial)
    capture(options, camera, lambda: Ring(options.port or find_port()))


def capture(options: Options, camera: Camera, open_ring: Callable[[], Ring]) -> None:
    """Record the ring with the camera, join both, print what came out.

    Parameters
    ----------
    options : Options
        As on the command line.
    camera : Camera
        What records.
    open_ring : callable () -> Ring
        Gives the ring, which is dark when it is left.

    Raises
    ------
    InputError
        Something given can't be used, or camera or ring fail. A complete recording and its log stay.
    """
    check_range("--rounds", options.rounds, 1)
    settings = RingSettings(
        options.order,
        options.slot_us,
        options.crossfade,
        options.rounds,
        options.trim,
        options.constant_light,
        options.sync_slots,
    )
    check_folder(options.out)
    with open_ring() as ring:
        ring.configure(settings)
        options.out.mkdir(parents=True, exist_ok=True)
        camera.start(options.out / "recording.raw")
        try:
            _run(ring, options.rounds)
        except BaseException:
            camera.abandon()
            raise
    recording = camera.stop()
    log_file = options.out / "ring.json"
    write_log(log_file, ring.log)
    try:
        convert(recording, read_ring_log(log_file), options.out / "events.h5", options)
    except InputError as error:
        raise InputError(
            f"{str(error).removesuffix('.')}; the run is kept, so join it by "
            f"python -m evsdr.convert {recording} --ring {log_file}."
        ) from error


def _run(ring: Ring, n_round: int) -> None:
    """Run the ring to its end, with progress."""
    with Stages("capture") as stages, stages.stage("record") as advance:
        ring.start()
        while not ring.wait(POLL_S):
            advance(f"round {ring.log.rounds_done + 1}", ring.log.rounds_done / n_round)
