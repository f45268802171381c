"""`python -m evsdr.capture --port /dev/ttyACM0 --out DIR`: record the ring with a camera, join both.

The camera records before the ring starts and until after it ends. DIR gets the camera's recording (with the
vendor's SDK), ring.json and events.h5. Whatever goes wrong, the ring ends dark.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from evsdr.commands.console import run_command
from evsdr.commands.convert import JoinOptions, join_files
from evsdr.errors import InputError, check_range
from evsdr.files.atomic import check_folder
from evsdr.progress import Stages
from evsdr.rig.camera import Camera, Control, open_camera
from evsdr.rig.camera_settings import CameraSettings, parse_biases
from evsdr.rig.capture import RECORDING, capture, run_to_end
from evsdr.rig.driver import BLINK_US, N_LED, Ring, RingSettings, blinking, find_port, flickering

FOCUS_ROUNDS = round(600e6 / (2 * BLINK_US))  # ten minutes


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
    """Brightness of each LED, 0 to 1; a ring of 48 LEDs wants 48 numbers."""
    constant_light: bool = False
    """Switch on the constant light of the ring."""
    sync_slots: bool = False
    """Give an edge at each slot on the second trigger output."""
    flicker: bool = False
    """Instead of the ring, record its flicker, for `calibrate thresholds --waveform ring`: the first LED of the order fades
    out and in over the constant light, in slots of 0.4 s or more, for 20 rounds or more."""
    focus: bool = False
    """Instead of recording the ring, let the first LED of the order blink until Ctrl-C, ten minutes at most, beside a preview
    which tells how sharp the picture is; nothing is joined."""
    camera: Control = "auto"
    """Who starts and stops the camera: the vendor's SDK, or you by hand; auto takes the SDK where it is
    installed."""
    serial: str = ""
    """Serial number of the camera; the first one if empty."""
    bias: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """name=value of a bias of the camera, as bias_diff_on=20; may be repeated. With the SDK; all are stored in camera.json."""
    region: tuple[int, int, int, int] | None = None
    """Left, top, width and height of the pixels that may fire; with the SDK. The recording is cropped to it."""
    event_rate: float | None = None
    """Most events in a second, beyond which the camera drops some; 0 switches this control off. With the SDK."""
    recording: Path | None = None
    """File that your own camera software writes; it is awaited instead of asked for."""
    preview: bool = False
    """Show on a page of this machine what is being recorded: events, the light of each LED, and whether triggers and events
    go with the schedule. Its address is printed."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("capture", Options, command, argv)


def command(options: Options) -> None:
    """Record, join, print what came out."""
    settings = CameraSettings(parse_biases(options.bias), options.region, options.event_rate)
    camera = open_camera(options.camera, options.recording, options.serial, settings)
    options = replace(options, crop=options.crop or options.region)
    record_and_join(options, camera, lambda: Ring(options.port or find_port()))


def record_and_join(options: Options, camera: Camera, open_ring: Callable[[], Ring]) -> None:
    """Record the ring with a camera, join both; a complete recording and its log stay if they don't fit."""
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
    if options.flicker:
        settings = flickering(settings)
    elif options.focus:
        settings = replace(blinking(settings), rounds=FOCUS_ROUNDS)
    check_folder(options.out)
    with _preview(options, camera, settings):
        recording, log = capture(camera, open_ring, settings, options.out, _run)
    if options.focus:
        return
    try:
        join_files(recording, log, options.out / "events.h5", options)
    except InputError as error:
        raise InputError(
            f"{str(error).removesuffix('.')}; the run is kept, so join it by "
            f"python -m evsdr.convert {recording} --ring {log}."
        ) from error


def _preview(options: Options, camera: Camera, settings: RingSettings) -> AbstractContextManager:
    """Show the recording, if that is asked for."""
    if not (options.preview or options.focus):
        return nullcontext()
    from evsdr.viewing.beside import beside, check_preview

    path = camera.growing(options.out / RECORDING)
    check_preview(path)
    return beside(path, settings.order, settings.slot_us, settings.crossfade, options.crop)


def _run(ring: Ring, n_round: int) -> None:
    """Run the ring to its end, with progress; only now, as a camera by hand asks before and after."""
    with Stages("capture", ("record",)) as stages, stages.stage("record") as advance:
        run_to_end(ring, n_round, advance)
