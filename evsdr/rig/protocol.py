"""Talk to the ring over a serial line; `firmware/README.md` documents the protocol.

A request is `number NAME arguments*CRC`, its answer `number OK words*CRC` or `number ERR code words*CRC`. The
checksum is CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF) of all that is before the asterisk. A line
that was spoiled on its way is sent again; a command that comes twice does what it does once.
"""

import binascii
import threading
import time
from dataclasses import dataclass

import serial

PROTOCOL = 1
BAUD = 500_000
LONGEST_LINE = 256  # of an answer; longer ones are garbage
REPEAT_S = 0.02  # without an answer a request is sent again
LOST_S = 1.0  # after so long the ring is lost
BOOT_S = 4.0  # an Arduino restarts when its port is opened, and may take so long


class RingLost(Exception):
    """The ring does not answer any more."""


class RingRefused(Exception):
    """The ring has answered ERR; the message holds its words."""


@dataclass(frozen=True)
class Answer:
    """Words and `name=value` pairs of an OK."""

    words: tuple[str, ...]
    values: dict[str, str]

    def number(self, name: str) -> int:
        """Give a value that is a whole number; raises RingRefused where there is none."""
        text = self.values.get(name, "")
        if not text.isdecimal():
            raise RingRefused(f"its answer lacks a number {name}")
        return int(text)


def frame(text: str) -> bytes:
    """Give the bytes of a line."""
    data = text.encode("ascii")
    return b"%s*%04X\n" % (data, binascii.crc_hqx(data, 0xFFFF))


def unframe(line: bytes) -> str | None:
    """Give the text of a line without its end, or None if it was spoiled."""
    data, star, checksum = line.rpartition(b"*")
    if not star or checksum != b"%04X" % binascii.crc_hqx(data, 0xFFFF) or not data.isascii():
        return None
    return data.decode("ascii")


class Link:
    """Requests and answers over an open port; may be used from several threads.

    Parameters
    ----------
    port : serial.Serial
        Open, with a short timeout.
    """

    def __init__(self, port: serial.Serial):
        self._port = port
        self._lock = threading.Lock()
        self._number = 0
        self._rest = b""

    def ask(self, command: str, patience_s: float | None = None) -> Answer:
        """Send a command until it is answered.

        Parameters
        ----------
        command : str
            Name and arguments.
        patience_s : float, optional
            When to give up [s]; by default after LOST_S.

        Raises
        ------
        RingLost
            No answer came.
        RingRefused
            The answer is ERR.
        """
        with self._lock:
            self._number = self._number % 65535 + 1
            line = frame(f"{self._number} {command}")
            try:
                return self._ask(line, str(self._number), LOST_S if patience_s is None else patience_s)
            except (
                serial.SerialException,
                OSError,
                TypeError,
            ) as error:  # TypeError: closed by another thread
                raise RingLost(f"the port has gone ({error})") from error

    def _ask(self, line: bytes, number: str, patience_s: float) -> Answer:
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            self._port.write(line)
            repeat = min(time.monotonic() + REPEAT_S, end)
            while time.monotonic() < repeat:
                for text in self._read():
                    who, _, words = text.partition(" ")
                    if who == "-" and words.startswith("ERR"):
                        repeat = 0.0  # a line was spoiled: again, at once
                    elif who == number:
                        return _parse(words)
        raise RingLost("no answer comes")

    def _read(self) -> list[str]:
        """Give the whole lines that have come."""
        *lines, self._rest = (self._rest + self._port.read(self._port.in_waiting or 1)).split(b"\n")
        self._rest = self._rest[-LONGEST_LINE:]
        return [text for text in map(unframe, lines) if text is not None]


def _parse(words: str) -> Answer:
    status, *rest = words.split(" ")
    if status != "OK":
        raise RingRefused(words.removeprefix("ERR "))
    pairs = [word.partition("=") for word in rest if "=" in word]
    return Answer(tuple(word for word in rest if "=" not in word), {name: value for name, _, value in pairs})
