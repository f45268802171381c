"""Read Prophesee RAW files: a header in text, then words of EVT 2.0, EVT 2.1 or EVT 3.0."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.scratch import columns
from evsdr.records import Events
from evsdr.rig import evt_words as kernel
from evsdr.rig.camera_file import (
    EDGE_FIELDS,
    EVENT_FIELDS,
    CameraRecording,
    Edges,
    check_recording,
    read_size,
    warn,
)

WORDS = {"EVT2": np.dtype("<u4"), "EVT21": np.dtype("<u8"), "EVT3": np.dtype("<u2")}
HEADER_SIZE = 1 << 16  # bytes in which a header ends
UNKNOWN_SHARE = 1e-3  # of the words; with more of unknown type the file is something else
BLOCK = 1 << 22  # words that are decoded together
N_GUESS = 1 << 16  # words that tell how the halves of EVT 2.1 are ordered


@dataclass(frozen=True)
class Layout:
    """How the words of a file are read.

    Attributes
    ----------
    name : str
        One of `WORDS`.
    start : int
        Where they begin [bytes].
    width, height : int
        Of the sensor [pixels].
    endianness : str or None
        As the header tells.
    """

    name: str
    start: int
    width: int
    height: int
    endianness: str | None

    @property
    def word(self) -> np.dtype:
        """Give the type of a word."""
        return WORDS[self.name]


def is_raw(path: Path) -> bool:
    """Tell whether a file starts as the vendor's do."""
    with open(path, "rb") as file:
        return file.read(2) == b"% "


def read_raw(path: str | Path, size: tuple[int, int] | None = None) -> CameraRecording:
    """Read a RAW file with its triggers.

    Parameters
    ----------
    path : str or Path
        RAW file.
    size : (width, height), optional
        Of the sensor; that of the header if None.

    Raises
    ------
    InputError
        The file is no RAW file, of another format, or damaged.

    Warns
    -----
    InputWarning
        It is cut short, or slightly damaged.
    """
    path = Path(path)
    layout = read_layout(path, size)
    width, height, name = layout.width, layout.height, layout.name
    words = Words(path, layout)
    n_word = len(words)
    if not n_word:
        raise InputError(f"{path}: nothing follows its header; record again.")
    count, events, edges = decode(layout, words)
    n_unknown = count[kernel.N_UNKNOWN]
    if n_unknown > UNKNOWN_SHARE * n_word:
        raise InputError(
            f"{path}: {n_unknown / n_word:.1%} of its words are no {name}, the format that its header "
            "names; the file is damaged or its header is another's: copy it again."
        )
    recording = CameraRecording(width, height, events, edges)
    recording = check_recording(path, recording, int(count[kernel.N_OUTSIDE]))
    if n_unknown:
        warn(f"{path}: {n_unknown} of its words are unknown and left out; it is slightly damaged.")
    left_over = (path.stat().st_size - layout.start) % layout.word.itemsize
    if left_over:
        warn(f"{path}: its last word is cut short, so its last {left_over} bytes are left out.")
    return recording


def read_layout(path: Path, size: tuple[int, int] | None = None) -> Layout:
    """Read the header of a RAW file; arguments and errors as those of `read_raw`."""
    fields, start = _read_header(path)
    name, options = _read_format(path, fields)
    width, height = size or read_size(path, _geometry(fields, options), "header does", 2048)
    return Layout(name, start, width, height, options.get("endianness"))


@dataclass(frozen=True)
class Words:
    """The words of a file, block by block, as often as wanted; their types lie in the highest bits."""

    path: Path
    layout: Layout

    def __len__(self) -> int:
        return (self.path.stat().st_size - self.layout.start) // self.layout.word.itemsize

    def __iter__(self) -> Iterator[np.ndarray]:
        layout = self.layout
        with open(self.path, "rb") as file:
            file.seek(layout.start)
            while len(words := np.fromfile(file, layout.word, BLOCK)):
                if layout.name == "EVT21" and not layout.endianness:  # the first block tells
                    swapped = _has_swapped_halves(self.path, words, None)
                    layout = replace(layout, endianness="legacy" if swapped else "little")
                yield straight(self.path, layout, words)


def straight(path: Path, layout: Layout, words: np.ndarray) -> np.ndarray:
    """Give words with their type in the highest bits: some cameras swap the halves of EVT 2.1."""
    if layout.name == "EVT21" and _has_swapped_halves(path, words, layout.endianness):
        return (words >> np.uint64(32)) | (words << np.uint64(32))
    return words


def _read_header(path: Path) -> tuple[dict[str, str], int]:
    """Read `% key value` lines; give them and where the words start."""
    with open(path, "rb") as file:
        head = file.read(HEADER_SIZE)
    fields, start = {}, 0
    while head.startswith(b"% ", start):
        end = head.find(b"\n", start)
        if end < 0:
            raise InputError(f"{path}: its header has no end; copy the file again.")
        key, _, value = head[start + 2 : end].decode("latin-1").strip().partition(" ")
        start = end + 1
        if key == "end":
            break
        fields[key] = value.strip()
    if not fields:
        raise InputError(
            f"{path}: this is no RAW file of a Prophesee camera; name a .raw or .hdf5 recording."
        )
    return fields, start


def _read_format(path: Path, fields: dict[str, str]) -> tuple[str, dict[str, str]]:
    """Give the name of the format and its options."""
    name, *options = fields.get("format", "").split(";")
    if not name and "evt" in fields:
        name = {"2.0": "EVT2", "2.1": "EVT21", "3.0": "EVT3"}.get(fields["evt"], f"EVT {fields['evt']}")
    if name not in WORDS:
        raise InputError(
            f"{path}: its header names {'the format ' + name if name else 'no format'}, "
            "but EVT2, EVT21 and EVT3 can be read; set the camera to EVT3."
        )
    options = dict(option.partition("=")[::2] for option in options)
    return name, {"endianness": fields["endianness"], **options} if "endianness" in fields else options


def _geometry(fields: dict[str, str], options: dict[str, str]) -> str:
    return fields.get("geometry", f"{options.get('width')}x{options.get('height')}")


def _has_swapped_halves(path: Path, words: np.ndarray, endianness: str | None) -> bool:
    """Tell whether each EVT 2.1 word has its upper half first; as the words look, if the header is silent."""
    if endianness not in (None, "little", "legacy"):
        raise InputError(f"{path}: its byte order is {endianness}, but only little and legacy can be read.")
    if endianness:
        return endianness == "legacy"
    known = np.isin(
        np.arange(16), [kernel.CD_OFF, kernel.CD_ON, kernel.TIME_HIGH, kernel.TRIGGER, kernel.OTHERS]
    )
    halves = words[:N_GUESS].view(np.uint32).reshape(-1, 2)
    low, high = np.count_nonzero(known[halves >> 28], axis=0)
    return bool(low > high)


def decode(layout: Layout, words: Iterable[np.ndarray]) -> tuple[np.ndarray, Events, Edges]:
    """Decode blocks of words; they are gone through twice.

    Returns
    -------
    count : (N_COUNT,) int
        The counts of `evt_words`.
    events : Events
        On disk where memory is short.
    edges : Edges
        Of the trigger inputs.
    """
    size, masked = (layout.width, layout.height), layout.name == "EVT21"
    if layout.name == "EVT3":
        room_of, write = kernel.room_evt3, kernel.decode_evt3
    else:
        room_of, write = (
            partial(kernel.room_evt2, has_mask=masked),
            partial(kernel.decode_evt2, has_mask=masked),
        )
    room = np.sum([room_of(block) for block in words] or [(0, 0)], axis=0).tolist()
    what = f"a recording of {room[0]} events"
    arrays = [columns(n, kinds, what) for n, kinds in zip(room, (EVENT_FIELDS, EDGE_FIELDS))]
    written = [array for kind in arrays for array in kind.values()]
    state, count = kernel.fresh()
    for block in words:
        write(block, *size, *written, state, count)
    n_event, n_trigger = np.minimum(count[[kernel.N_EVENT, kernel.N_TRIGGER]], room)
    events, edges = (
        {name: array[:n] for name, array in kind.items()} for n, kind in zip((n_event, n_trigger), arrays)
    )
    return count, Events(**events), Edges(**edges)
