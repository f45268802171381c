"""`python -m evsdr.ring run|stop|status|test`: the real ring of LEDs at a serial port.

From Python see `evsdr.rig.driver`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from evsdr.commands.console import print_table, run_command
from evsdr.errors import InputError
from evsdr.rig.driver import N_LED, Ring, RingSettings, blinking, find_port, flickering
from evsdr.rig.log import write_ring_log
from evsdr.signals import undisturbed

TEST_US = 300_000  # that each LED shines in a test
WHY = {
    "watchdog": "the ring went dark by itself: it was not kept alive, or a limit was passed",
    "reset": "the ring has restarted",
    "lost": "the ring does not answer any more",
}


@dataclass(frozen=True)
class Options:
    """Run the ring of LEDs, stop it, ask how it is, or light each LED in turn."""

    action: tyro.conf.Positional[Literal["run", "stop", "status", "test", "flicker", "blink"]]
    """run: until its rounds are done, or Ctrl-C; test: each LED in turn; flicker: the first LED of order fades out and in
    over the constant light, with a dark slot between, for `calibrate thresholds --waveform ring`; blink: the first LED of order goes on and off
    five times a second until Ctrl-C, so that the camera sees edges to focus on."""
    port: str | None = None
    """Serial port; by default the only Arduino that is plugged in."""
    slot_us: float = 20_000.0
    """Length of a slot [us], 200 to 1,000,000."""
    crossfade: float = 1.0
    """Fraction of a slot's end over which an LED fades into the next; 0 is a hard switch."""
    rounds: int = 6
    """Rounds of the ring; 0 until stopped by Ctrl-C."""
    order: tuple[int, ...] | None = None
    """LED of each slot of a round, -1 for none; by default each LED in turn."""
    trim: tuple[float, ...] | None = None
    """Brightness of each LED, 0 to 1; by default 24 times 1. A ring of 48 LEDs wants 48 numbers."""
    constant_light: bool = False
    """Switch on the constant light while the ring runs."""
    sync_slots: bool = False
    """Give an edge at each slot on the second trigger output."""
    log: Annotated[Path, tyro.conf.arg(aliases=["--out"])] = Path("ring.json")
    """Where run writes what was lit when."""


class _Stopped(KeyboardInterrupt):
    """A run was stopped by Ctrl-C, and its log is written."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("ring", Options, command, argv)


def command(options: Options) -> None:
    """Do the action."""
    settings = make_settings(options)
    if options.action == "flicker":
        settings = flickering(settings)
    elif options.action == "blink":
        settings = blinking(settings)
    if not options.log.parent.is_dir():
        raise InputError(f"{options.log.parent}: there is no such folder; make it, or give another --log.")
    with Ring(options.port or find_port()) as ring:
        if options.action in ("run", "flicker", "blink"):
            run(ring, settings, options.log)
        elif options.action == "test":
            test(ring)
        else:  # opening it has stopped it
            print_table(ring.port, [("firmware", ring.firmware), *ring.status().items()])


def make_settings(options: Options) -> RingSettings:
    """Give the settings of the options, checked."""
    trim = (1.0,) * N_LED if options.trim is None else options.trim
    order = tuple(range(len(trim))) if options.order is None else options.order
    return RingSettings(
        order,
        options.slot_us,
        options.crossfade,
        options.rounds,
        trim,
        options.constant_light,
        options.sync_slots,
    )


def run(ring: Ring, settings: RingSettings, path: Path) -> None:
    """Run, with progress; write the log whatever happens."""
    console = Console(stderr=True)
    columns = (TextColumn("ring: rounds"), BarColumn(bar_width=30), MofNCompleteColumn(), TimeElapsedColumn())
    try:
        with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as progress:
            task = progress.add_task("", total=settings.rounds or None)
            ring.run(settings, lambda done: progress.update(task, completed=done))
    except KeyboardInterrupt:
        with undisturbed():
            ring.stop()
            if ring.log is None:
                raise
            write_ring_log(path, ring.log)
        raise _Stopped(f"{ring.log.rounds_done} rounds are complete, {path} tells of them.") from None
    write_ring_log(path, ring.log)
    if ring.log.ended in WHY:
        raise InputError(
            f"{ring.port}: {WHY[ring.log.ended]} after {ring.log.rounds_done} complete rounds "
            f"({path} tells more); check cable, supply and how busy this computer is."
        )
    print_table(str(path), [("rounds", str(ring.log.rounds_done)), ("ended", ring.log.ended)])


def test(ring: Ring) -> None:
    """Light each LED in turn."""
    for led in range(ring.n_led):
        print(f"LED {led}, {'odd' if led % 2 else 'even'} chain", flush=True)
        log = ring.run(RingSettings((led,), TEST_US, 0.0, 1, (1.0,) * ring.n_led))
        if log.ended != "done":
            raise InputError(
                f"{ring.port}: {WHY.get(log.ended, log.ended)} at LED {led}; check cable and supply."
            )
