"""Talk to the ring over a serial line; `firmware/README.md` documents the protocol.

A request is `number NAME arguments*CRC`, its answer `number OK words*CRC` or `number ERR code words*CRC`. The
checksum is CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF) of all that is before the asterisk. A line
that was spoiled on its way is sent again; a command that comes twice does what it does once.
"""

import binascii
from dataclasses import dataclass

PROTOCOL = 1
BAUD = 500_000
LONGEST_LINE = 256  # of an answer; longer ones are garbage
BEAT_S = 0.01  # between two lines that keep the ring alive
ALIVE_MS = 49  # that the ring shall wait for one: dark within 50 ms
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


class Lines:
    """Puts together the lines that come in pieces."""

    def __init__(self):
        self._rest = b""

    def take(self, data: bytes) -> list[str]:
        """Give the texts of the lines that are whole now, but the spoiled ones."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-LONGEST_LINE:]
        return [text for text in map(unframe, lines) if text is not None]


def parse(words: str) -> Answer:
    """Read the words of an answer; raises RingRefused where it is ERR."""
    status, *rest = words.split(" ")
    if status != "OK":
        raise RingRefused(words.removeprefix("ERR "))
    pairs = [word.partition("=") for word in rest if "=" in word]
    return Answer(tuple(word for word in rest if "=" not in word), {name: value for name, _, value in pairs})
