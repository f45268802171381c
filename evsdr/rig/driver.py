"""The ring of 24 LEDs at a serial port: open, configure, run, stop, and know what was lit when.

with Ring(find_port()) as ring:
    log = ring.run(RingSettings(slot_us=10_000, rounds=6))
"""

import contextlib
import string
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, timezone

import numpy as np
import serial
from serial.tools import list_ports

from evsdr.errors import InputError
from evsdr.events.record import FLICKER_ROUNDS, FLICKER_US, flicker_order
from evsdr.rig.link import Heard, Link
from evsdr.rig.log import RunLog
from evsdr.rig.protocol import ALIVE_MS, BAUD, BOOT_S, PROTOCOL, Answer, RingLost, RingRefused
from evsdr.signals import undisturbed

N_LED = 24
SIZES = (24, 48)  # of rings
MAX_SLOTS = 256
SLOT_US = (200, 1_000_000)
MAX_ROUNDS = 999_999_999
MAX_ON_US = 2_000_000  # in a row; the firmware enforces it
PERIOD = 256  # cycles of the carrier
CYCLES_PER_US = 16
BLINK_US = 100_000.0  # of a slot, on or off
ORDER_STEP = 96  # slots that a line of the protocol holds
LETTERS = string.ascii_uppercase + string.ascii_lowercase  # of LEDs
USB = {(0x2341, None), (0x2A03, None), (0x1A86, 0x7523), (0x0403, 0x6001)}  # Arduino, CH340, FTDI
CAUSES = {"done": "done", "stop": "stopped", "none": "reset"}  # all others: the firmware's watchdog


@dataclass(frozen=True)
class RingSettings:
    """What the ring shall do.

    Attributes
    ----------
    order : tuple of int
        LED of each slot of a round, -1 for none; 256 slots at most. Neighbours that fade into each
        other must lie on different chains, one even, one odd.
    slot_us : float
        Length of a slot [us], 200 to 1,000,000, in whole microseconds.
    crossfade : float
        Fraction of a slot's end over which an LED fades into the next, 0..1.
    rounds : int
        0 for until stopped.
    trim : tuple of float
        Brightness of each LED, 0..1: 24 numbers, or 48 for a ring of 48 LEDs.
    constant_light : bool
        Switch the constant light on.
    sync_slots : bool
        Give an edge per slot too.

    Raises
    ------
    InputError
        A value can't be used.
    """

    order: tuple[int, ...] = tuple(range(N_LED))
    slot_us: float = 20_000.0
    crossfade: float = 1.0
    rounds: int = 6
    trim: tuple[float, ...] = (1.0,) * N_LED
    constant_light: bool = False
    sync_slots: bool = False

    @property
    def n_led(self) -> int:
        """LEDs of the ring."""
        return len(self.trim)

    def __post_init__(self):
        if self.n_led not in SIZES or not all(0 <= value <= 1 for value in self.trim):
            raise InputError(
                f"trim must hold {N_LED} or {max(SIZES)} numbers from 0 to 1, one per LED; correct it."
            )
        if not 1 <= len(self.order) <= MAX_SLOTS:
            raise InputError(f"order has {len(self.order)} slots; give 1 to {MAX_SLOTS}.")
        if not all(-1 <= led < self.n_led for led in self.order):
            raise InputError(f"order must list LEDs 0 to {self.n_led - 1}, or -1 for none; correct it.")
        if not SLOT_US[0] <= self.slot_us <= SLOT_US[1] or self.slot_us % 1:
            raise InputError(
                f"slot_us is {self.slot_us:g}; give whole microseconds from {SLOT_US[0]} to {SLOT_US[1]}."
            )
        if not 0 <= self.crossfade <= 1:
            raise InputError(f"crossfade is {self.crossfade:g}; give a fraction from 0 to 1.")
        if not 0 <= self.rounds <= MAX_ROUNDS:
            raise InputError(f"rounds is {self.rounds}; give 0 (until stopped) to {MAX_ROUNDS}.")
        if self.crossfade > 0:
            for k, (led, then) in enumerate(self._neighbours()):
                if led != then and min(led, then) >= 0 and (led - then) % 2 == 0:
                    raise InputError(
                        f"order lets LED {led} fade into LED {then} in slot {k}, but both hang on one chain; "
                        "put an odd LED between even ones, or -1, or set crossfade to 0."
                    )
        if self._longest_us() > MAX_ON_US:
            raise InputError(
                f"order lights an LED for longer than {MAX_ON_US * 1e-6:g} s in a row; "
                "shorten slot_us or put -1 between its slots."
            )

    def _neighbours(self) -> list[tuple[int, int]]:
        return list(zip(self.order, self.order[1:] + self.order[:1]))

    def _longest_us(self) -> float:
        """Give the longest time that an LED is lit in a row, fades included, the next round too."""
        rounds = min(self.rounds or MAX_ROUNDS, 2 + MAX_ON_US // int(self.slot_us * len(self.order)))
        slots = np.array(self.order * rounds + (self.order[:1] if self.crossfade else ()), int)
        starts = np.flatnonzero(np.diff(slots, prepend=-2))
        count = np.diff(starts, append=len(slots)) + (starts > 0) * (self.crossfade > 0)
        return float(self.slot_us * np.max(count[slots[starts] >= 0], initial=0))


def flickering(settings: RingSettings) -> RingSettings:
    """Let the first LED of an order flicker over the constant light, with a dark slot in each round."""
    slow = max(settings.slot_us, FLICKER_US)
    rounds = max(settings.rounds, FLICKER_ROUNDS) if settings.rounds else 0
    order = flicker_order(settings.order)
    return replace(settings, order=order, slot_us=slow, crossfade=1.0, rounds=rounds, constant_light=True)


def blinking(settings: RingSettings) -> RingSettings:
    """Let the first LED of an order go on and off until stopped: what does not move shows its edges then."""
    led = flicker_order(settings.order)[0]
    return replace(settings, order=(led, -1), slot_us=BLINK_US, crossfade=0.0, rounds=0)


def order_commands(order: tuple[int, ...]) -> list[str]:
    """Give the commands that set an order."""
    text = "".join("." if led < 0 else LETTERS[led] for led in order)
    more = [f"MORE {at} {text[at : at + ORDER_STEP]}" for at in range(ORDER_STEP, len(text), ORDER_STEP)]
    return [f"ORDER {text[:ORDER_STEP]}", *more]


def find_port() -> str:
    """Give the port of the only Arduino that is plugged in.

    Raises
    ------
    InputError
        There is none, or more than one.
    """
    ports = [
        port.device
        for port in list_ports.comports()
        if (port.vid, None) in USB or (port.vid, port.pid) in USB
    ]
    if not ports:
        raise InputError("No ring is plugged in, as far as its USB number tells; name its port by --port.")
    if len(ports) > 1:
        raise InputError(
            f"Several boards are plugged in ({', '.join(ports)}); name the ring's port by --port."
        )
    return ports[0]


class Ring:
    """The ring at a port, as a context manager that always ends dark.

    A process of its own keeps the ring alive while it is open: without it all goes dark within 50 ms. It ends with
    this one.

    Parameters
    ----------
    port : str
        Name of the serial port, or of a terminal.

    Attributes
    ----------
    firmware : str
        What the ring says it is.
    log : RunLog or None
        Of the run that was started last.

    Raises
    ------
    InputError
        On entering: the port can't be opened, nothing on it answers, or it speaks another version.
    """

    def __init__(self, port: str):
        self.port, self.firmware, self.log = port, "", None
        self._settings: dict | None = None
        self._ended = threading.Event()
        self._ended.set()
        self._start = 0.0

    def __enter__(self) -> "Ring":
        try:
            self._serial = serial.Serial(self.port, BAUD, timeout=0.005, write_timeout=1, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as error:
            raise InputError(
                f"{self.port}: cannot be opened ({_reason(error)}); check the cable, or who else uses it."
            ) from error
        try:
            self._link = Link(self._serial, Heard(self._look_at, self._boot, lambda why: self._end("lost")))
            try:
                self._meet()
            except BaseException:
                self._link.close()
                raise
        except BaseException:
            self._serial.close()
            raise
        return self

    def __exit__(self, *_) -> None:
        with undisturbed():
            try:
                self.stop()
                with contextlib.suppress(RingLost, RingRefused):
                    self._link.ask("LIGHT 0")
            finally:
                self._link.close()
                self._serial.close()

    def _meet(self) -> None:
        try:
            self._link.ask("STOP", BOOT_S)  # whatever it does: dark
            hello = self._link.ask("HELLO")
            with contextlib.suppress(RingRefused):  # an older firmware has 40 ms
                self._link.ask(f"ALIVE {ALIVE_MS}")
        except RingLost as error:
            raise InputError(
                f"{self.port}: no ring answers there; check the port, and that the firmware is on it."
            ) from error
        except RingRefused as error:
            raise InputError(f"{self.port}: the ring refused ({error}); flash its firmware again.") from error
        version = hello.values.get("protocol")
        if version != str(PROTOCOL):
            raise InputError(
                f"{self.port}: the ring speaks version {version} of the protocol, evsdr version {PROTOCOL}; "
                "flash the firmware that belongs to this evsdr."
            )
        self.firmware = f"{' '.join(hello.words)} protocol {version}"
        self._room = hello.number("leds"), hello.number("slots")

    def _ask(self, command: str):
        try:
            return self._link.ask(command)
        except RingRefused as error:
            raise InputError(f"{self.port}: the ring refused {command.split()[0]} ({error}).") from error
        except RingLost as error:
            raise InputError(f"{self.port}: the ring is lost, {error}; check cable and supply.") from error

    # ---- what one does with a ring -------------------------------------------------------------------

    def configure(self, settings: RingSettings) -> None:
        """Send the settings of the next run; the constant light is switched at once.

        Raises
        ------
        InputError
            The ring refuses them, has other LEDs, or is lost.
        """
        if settings.n_led != self._room[0] or len(settings.order) > self._room[1]:
            raise InputError(
                f"{self.port}: the ring has {self._room[0]} LEDs and up to {self._room[1]} slots, not "
                f"{settings.n_led} and {len(settings.order)}; correct trim and order, or flash another firmware."
            )
        levels = [round(255 * value) for value in settings.trim]
        ppm = round(1e6 * settings.crossfade)
        slot = self._ask(f"SLOT {int(settings.slot_us)} {ppm}")
        for command in order_commands(settings.order):
            self._ask(command)
        self._ask("TRIM " + "".join(f"{level:02X}" for level in levels))
        self._ask(f"ROUNDS {settings.rounds}")
        self._ask(f"SYNC {int(settings.sync_slots)}")
        self._ask(f"LIGHT {int(settings.constant_light)}")
        periods, fade = slot.number("periods"), slot.number("fade")
        faded = fade * PERIOD + (slot.number("extra") if fade == periods else 0)
        self._settings = {
            "order": list(settings.order),
            "slot_us": float(settings.slot_us),
            "crossfade": faded / (settings.slot_us * CYCLES_PER_US),
            "rounds": settings.rounds,
            "trim": [level / 255 for level in levels],
            "constant_light": settings.constant_light,
            "sync_slots": settings.sync_slots,
        }

    def start(self) -> None:
        """Start a run and come back at once.

        Raises
        ------
        InputError
            The ring refuses or is lost, or was not configured.
        """
        if self._settings is None:
            raise InputError("The ring has no settings yet; call configure before start.")
        if not self._ended.is_set():
            raise InputError("The ring runs already; stop it first.")
        self.log = RunLog(self.firmware, self._settings, datetime.now(timezone.utc).isoformat())
        self._start = time.monotonic()
        self._note("start")
        self._ask("RUN")
        self._ended.clear()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the end of the run; gives False if it still runs after the time [s]."""
        return self._ended.wait(timeout_s)

    def run(self, settings: RingSettings, on_round: Callable[[int], None] = lambda done: None) -> RunLog:
        """Configure, run to the end, and give the log.

        Parameters
        ----------
        settings : RingSettings
            What to do.
        on_round : callable (int) -> None
            Called now and then with the number of complete rounds.

        Raises
        ------
        InputError
            The ring refuses or is lost before the run begins.
        """
        self.configure(settings)
        self.start()
        while not self.wait(0.1):
            on_round(self.log.rounds_done)
        on_round(self.log.rounds_done)
        return self.log

    def stop(self) -> None:
        """Make all LEDs of the ring dark; the constant light stays as it is. Never raises."""
        with contextlib.suppress(RingLost, RingRefused):
            self._link.ask("STOP")
            if not self._ended.is_set():
                self._look(self._link.ask("STATUS"))
        self._end("lost")  # unless the ring has told why it ended

    @property
    def n_led(self) -> int:
        """LEDs of the ring."""
        return self._room[0]

    @property
    def silence_ms(self) -> float:
        """The longest time yet between two lines to the ring [ms]; all goes dark after 50."""
        return self._link.silence_ms

    def status(self) -> dict[str, str]:
        """Ask for the state: `run`, `rounds`, `light` and `cause`, the end of the last run."""
        return self._ask("STATUS").values

    # ---- watching over it ----------------------------------------------------------------------------

    def _look_at(self, status: Answer) -> None:
        if not self._ended.is_set():
            self._look(status)

    def _boot(self, words: str) -> None:
        if not self._ended.is_set():
            self._note(words)

    def _look(self, status) -> None:
        """Learn from a status how the run goes."""
        done = int(status.values.get("rounds", "0"))
        cause = status.values.get("cause", "")
        if status.values.get("run") == "1" or cause != "none":
            for n in range(self.log.rounds_done, done):
                self._note(f"round {n + 1} complete")
            self.log.rounds_done = max(done, self.log.rounds_done)
        if status.values.get("run") == "0":
            self._end(CAUSES.get(cause, "watchdog"), cause)

    def _end(self, ended: str, cause: str = "") -> None:
        if self._ended.is_set():
            return
        silence = f", {self.silence_ms:.0f} ms without a line to it" if cause == "alive" else ""
        self._note(f"{ended} ({cause}{silence})" if ended == "watchdog" else ended)
        self.log.ended = ended
        self._ended.set()

    def _note(self, text: str) -> None:
        self.log.lines.append((time.monotonic() - self._start, text))


def _reason(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error)).rstrip(".").splitlines()[0]
