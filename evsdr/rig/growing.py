"""A RAW file while a camera writes it: what has come since the last look. It only reads, and skips what it is too late for."""

import os
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.records import Events
from evsdr.rig import evt_words as kernel
from evsdr.rig.camera_file import CameraRecording, Edges
from evsdr.rig.raw import WORDS, Layout, decode, read_layout, straight

MOST_BYTES = 1 << 24  # of one look; guessed: a camera at its fastest writes so much in a tenth of a second
TIME_BITS = {
    "EVT2": (28, 6),
    "EVT21": (28, 6),
    "EVT3": (12, 12),
}  # of a time high, and of the time below it [us]


class Growing:
    """A RAW file that grows.

    Parameters
    ----------
    path : Path
        There may be no file yet; of one that is there already only what is added counts, unless it is replaced.
    most_bytes : int
        To be read at a time: of more the oldest are skipped.

    Attributes
    ----------
    skipped : int
        Bytes that were left out.
    trouble : str
        Why the file can't be read; empty if nothing is wrong.
    """

    def __init__(self, path: Path, most_bytes: int = MOST_BYTES):
        self.path, self._most = Path(path), most_bytes
        self.skipped, self.trouble = 0, ""
        self._old = _identity(self.path)
        self._file = self._number = None

    def take(self) -> CameraRecording | None:
        """Give events and edges that came since the last call, between two words of time; None if none did."""
        try:
            words = self._words() if self._is_open() else np.empty(0, "<u2")
        except (OSError, InputError) as error:
            self.trouble = str(error)
            return None
        kind = words >> (8 * words.itemsize - 4)
        high = np.flatnonzero(kind == kernel.TIME_HIGH)
        if len(high) < 2:
            if len(words):
                self._rest = words
            return None
        first, last = high[0], high[-1]
        late = self._late(words[high])
        self._rest, words = words[last:], np.concatenate([self._state, words[first:last]])
        _, events, edges = decode(self._layout, [words])
        if self._layout.name == "EVT3":
            self._state = _state(words, self._rest[0])
        return CameraRecording(
            self._layout.width,
            self._layout.height,
            Events(events.x, events.y, events.p, events.t + late),
            Edges(edges.p, edges.t + late, edges.id),
        )

    def close(self) -> None:
        """Close the file."""
        if self._file:
            self._file.close()
            self._file = None

    def _is_open(self) -> bool:
        """Open the file once it holds more than its header, and anew when it is replaced."""
        now = _identity(self.path)
        if self._file and now and (now[0] != self._number or now[1] < self._file.tell()):
            self.close()
            self._old = None
        if self._file or not now:
            return bool(self._file)
        layout = read_layout(self.path)  # which raises while the header is not whole
        if now[1] <= layout.start:
            return False
        self._layout, self._file, self._number = layout, open(self.path, "rb", buffering=0), now[0]
        added = self._old is not None and self._old[0] == now[0] and self._old[1] <= now[1]
        size = layout.word.itemsize
        begin = max(self._old[1] - layout.start, 0) // size * size if added else 0
        self._file.seek(layout.start + begin)
        self._high, self._bytes, self.trouble = None, b"", ""
        self._rest = self._state = np.empty(0, layout.word)
        return True

    def _words(self) -> np.ndarray:
        """Read what is new, the newest of it if that is too much, behind what was left over."""
        size = self._layout.word.itemsize
        behind = os.fstat(self._file.fileno()).st_size - self._file.tell() - self._most
        if behind > 0:
            behind = -(-(behind + len(self._bytes)) // size) * size - len(self._bytes)
            self._file.seek(behind, os.SEEK_CUR)
            self.skipped += behind
            self._bytes, self._rest, self._state = b"", self._rest[:0], self._rest[:0]
        data = self._bytes + self._file.read(self._most)
        whole = len(data) // size * size
        self._bytes = data[whole:]
        new = np.frombuffer(data[:whole], self._layout.word)
        return np.concatenate([self._rest, straight(self.path, self._layout, new) if len(new) else new])

    def _late(self, highs: np.ndarray) -> int:
        """Give how much later than the words say their times are [us], as the clock has run over before."""
        bits, below = TIME_BITS[self._layout.name]
        told = (highs >> (32 if highs.itemsize == 8 else 0)).astype(np.int64) & ((1 << bits) - 1)
        begin = int(told[0] if self._high is None else kernel.advance(self._high, told[0], 1 << bits))
        turns = np.count_nonzero(np.diff(told) < -(1 << (bits - 1)))
        self._high = begin + int(told[-1] - told[0]) + (turns << bits)
        return (begin - int(told[0])) << below


def warm_up() -> None:
    """Load, and the first time compile, what decodes, so that nobody waits for it later."""
    for name, word in WORDS.items():
        decode(Layout(name, 0, 1, 1, None), [np.empty(0, word)])
    kernel.advance(0, np.int64(0), 1)


def _state(words: np.ndarray, then: int) -> np.ndarray:
    """Give EVT 3.0 words that bring a decoder to where it is after these: row, and time, if the next time high is as now."""
    kind = words >> 12
    row, low = (np.flatnonzero(kind == name) for name in (kernel.ADDRESS_Y, kernel.TIME_LOW))
    other = np.flatnonzero((kind == kernel.TIME_HIGH) & (words != then))
    low = low[low > max(other, default=-1)][-1:]
    return np.concatenate([words[row[-1:]], words[:0] if not len(low) else [then], words[low]]).astype(
        words.dtype
    )


def _identity(path: Path) -> tuple[int, int] | None:
    """Give a file's number and size; None where there is none."""
    try:
        told = os.stat(path)
    except OSError:
        return None
    return told.st_ino, told.st_size
