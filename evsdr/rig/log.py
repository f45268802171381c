"""ring.json: what the ring of LEDs did during a recording."""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.atomic import atomic_path
from evsdr.files.events_h5 import LARGEST_LED
from evsdr.files.json_text import read_json

FORMAT, VERSION = "evsdr ring log", 1


@dataclass
class RunLog:
    """What a run did, as it goes into ring.json.

    Attributes
    ----------
    settings : dict
        Order, slot, crossfade and trim as the ring can do them, rounds as asked for.
    started_utc : str
        ISO 8601.
    rounds_done : int
        Complete rounds.
    lines : list of (float, str)
        Seconds since the start, and what happened.
    ended : str
        "done", "stopped", "watchdog", "reset" or "lost"; empty while it runs.
    """

    firmware: str
    settings: dict
    started_utc: str
    rounds_done: int = 0
    lines: list[tuple[float, str]] = field(default_factory=list)
    ended: str = ""

    def as_json(self) -> dict:
        """Give the content of ring.json."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "firmware": self.firmware,
            **self.settings,
            "rounds_done": self.rounds_done,
            "started_utc": self.started_utc,
            "log": [[round(seconds, 4), text] for seconds, text in self.lines],
            "ended": self.ended,
        }


@dataclass(frozen=True)
class RingLog:
    """A run of the ring, as read from ring.json.

    Attributes
    ----------
    order : (n_slot,) int32
        LED of each slot of a round, -1 for none.
    slot_us : float
        Length of a slot on the ring's clock [us].
    crossfade : float
        Fraction of a slot's end over which an LED fades into the next, 0..1.
    n_round : int
        Complete rounds.
    ended : str
        "done", or why the ring stopped before.
    trim : (n_led,) float32, optional
        Brightness of each LED, 0..1; None where the log does not tell.
    constant_light : bool, optional
        Whether the constant light was on; None where the log does not tell.
    source : str
        What it comes from, for sentences.
    """

    order: np.ndarray
    slot_us: float
    crossfade: float
    n_round: int
    ended: str
    trim: np.ndarray | None = None
    constant_light: bool | None = None
    source: str = "ring.json"

    @property
    def round_us(self) -> float:
        """Length of a round on the ring's clock [us]."""
        return len(self.order) * self.slot_us


def write_ring_log(path: Path, log: RunLog) -> None:
    """Write ring.json, a line per field."""
    lines = [f"{json.dumps(name)}: {json.dumps(value)}" for name, value in log.as_json().items()]
    with atomic_path(path) as temporary:
        temporary.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def read_ring_log(path: str | Path) -> RingLog:
    """Read ring.json.

    Parameters
    ----------
    path : str or Path
        As `python -m evsdr.ring run` writes it.

    Raises
    ------
    InputError
        The file is missing or of another kind, a field can't be used, or no round was completed.
    """
    fields = read_json(Path(path), "the ring.json of this recording")
    try:
        return parse_ring_log(fields)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def parse_ring_log(fields: object) -> RingLog:
    """Check the fields of ring.json.

    Raises
    ------
    InputError
        One can't be used; the sentence doesn't name the file.
    """
    if not isinstance(fields, dict) or fields.get("format") != FORMAT:
        raise InputError(f'its format is not "{FORMAT}"; name the ring.json of this recording.')
    if fields.get("version") != VERSION:
        raise InputError(
            f"its version is {fields.get('version')!r}, not {VERSION}; use the evsdr that wrote it."
        )
    order = fields.get("order")
    is_list = isinstance(order, list) and len(order) > 0 and all(type(led) is int for led in order)
    if not is_list or min(order) < -1 or not 0 <= max(order) <= LARGEST_LED:
        raise InputError(f"order must list the LED of each slot, 0 to {LARGEST_LED}, -1 where none is lit.")
    slot_us, crossfade = (_number(fields, name) for name in ("slot_us", "crossfade"))
    if slot_us <= 0:
        raise InputError(f"slot_us is {slot_us:g}; it must be above 0.")
    if not 0 <= crossfade <= 1:
        raise InputError(f"crossfade is {crossfade:g}; it must lie from 0 to 1.")
    n_round = fields.get("rounds_done")
    if type(n_round) is not int or n_round < 1:
        raise InputError(f"rounds_done is {n_round!r}, so no round was completed; run the ring again.")
    trim, constant_light = fields.get("trim"), fields.get("constant_light")
    if trim is not None:
        numbers = isinstance(trim, list) and all(type(value) in (int, float) for value in trim)
        if not numbers or not all(0 <= value <= 1 for value in trim) or max(order) >= len(trim):
            raise InputError("trim must list the brightness of each LED, 0 to 1; run the ring again.")
        trim = np.array(trim, np.float32)
    if type(constant_light) not in (bool, type(None)):
        raise InputError(f"constant_light is {constant_light!r}; it must be true or false.")
    ended = str(fields.get("ended"))
    return RingLog(np.array(order, np.int32), slot_us, crossfade, n_round, ended, trim, constant_light)


def _number(fields: dict, name: str) -> float:
    value = fields.get(name)
    if type(value) not in (int, float) or not math.isfinite(value):
        raise InputError(f"{name} must be a finite number; run the ring again.")
    return float(value)
