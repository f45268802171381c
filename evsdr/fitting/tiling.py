"""Which tiles a large recording is divided into."""

from dataclasses import dataclass

import numpy as np

from evsdr.events.chosen import count_events
from evsdr.records import Events, Recording

# Pixels and events that are solved together; measured: 43 kB a pixel of 100 events
AT_ONCE, EVENTS_AT_ONCE = 80_000, 10_000_000
MARGIN = (
    8  # pixels by which a tile goes beyond what it tells: priors tie neighbours, and these theirs; guessed
)


@dataclass(frozen=True)
class Tile:
    """A part of the image.

    Attributes
    ----------
    own, solved : (slice, slice)
        Rows and columns that it tells, and those that are solved.
    """

    own: tuple[slice, slice]
    solved: tuple[slice, slice]


def tiles_of(mask: np.ndarray, events: Events) -> list[Tile]:
    """Divide the masked part of an image into tiles that hold few enough pixels and events; none where one would do."""
    n = int(np.ceil(max(np.count_nonzero(mask) / AT_ONCE, counted(events, mask) / EVENTS_AT_ONCE)))
    if n <= 1:
        return []
    edges = [np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0)]
    (top, bottom), (left, right) = [(int(edge[0]), int(edge[-1]) + 1) for edge in edges]
    n_row = max(1, round(np.sqrt(n * (bottom - top) / (right - left))))
    rows, columns = _parts(top, bottom, n_row), _parts(left, right, -(-n // n_row))
    tiles = [Tile((r, c), tuple(_wider(s) for s in (r, c))) for r in rows for c in columns]
    return [tile for tile in tiles if mask[tile.own].any()]


def _parts(begin: int, end: int, n: int) -> list[slice]:
    edge = np.linspace(begin, end, n + 1).round().astype(int).tolist()
    return [slice(*both) for both in zip(edge[:-1], edge[1:])]


def _wider(part: slice) -> slice:
    return slice(max(part.start - MARGIN, 0), part.stop + MARGIN)


def expected(recording: Recording) -> int:
    """Give how many tiles a recording will take, 0 for none, as far as its events tell before a mask is known."""
    sensor = recording.sensor
    fired = count_events(recording.events, (sensor.height, sensor.width)) > 0
    return len(tiles_of(fired, recording.events))


def counted(events: Events, mask: np.ndarray) -> int:
    """Count the events of the masked pixels."""
    return int(count_events(events, mask.shape)[mask].sum())


def solved(mask: np.ndarray, tile: Tile) -> np.ndarray:
    """Give the masked pixels (height, width) bool of a tile."""
    out = np.zeros_like(mask)
    out[tile.solved] = mask[tile.solved]
    return out
