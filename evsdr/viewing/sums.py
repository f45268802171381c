"""What is kept of a recording while it is made: events over time and of each slot, triggers, and the light of each LED."""

import numpy as np

from evsdr.records import Events, Schedule
from evsdr.rig.camera_file import CameraRecording, Edges, between, no_edges
from evsdr.viewing.rounds import ON_GRID, Triggers, find_triggers

RATE_US = 100_000  # that are counted together
N_RATE = 300  # of these
MOST_SIDE = 160  # of pictures [pixels]; larger sensors are shown coarser
MOST_EVENTS = 4_000_000  # of a round; of more the newest count
MOST_EDGES = 1000
KEPT = 0.6  # of what rounds before have told, with each new one; guessed


class Sums:
    """Sums over the events of a recording.

    Parameters
    ----------
    schedule : Schedule
        As the ring is told.
    width, height : int
        Of the sensor [pixels].

    Attributes
    ----------
    n_event, n_round : int
        Events, and whole rounds between two triggers, yet.
    first_us, last_us : int
        Time of the first and the last event or edge; the same before there is any.
    step : int
        Pixels of the sensor along either side of one of the picture.
    per_slot : (2, n_slot) int64
        OFF and ON events of the last round.
    agree : float
        Of its events, those of a pixel in a slot that agree in polarity, see `sample.coherence`; NaN before.
    """

    def __init__(self, schedule: Schedule, width: int, height: int):
        self.schedule = schedule
        self._n_slot = len(schedule.order)
        self.round_us = schedule.slot_us * self._n_slot
        self.step = -(-max(width, height) // MOST_SIDE)
        self.height, self.width = (-(-size // self.step) for size in (height, width))
        self.n_event = self.n_round = 0
        self.first_us = self.last_us = None
        self.per_slot, self.agree = np.zeros((2, self._n_slot), np.int64), np.nan
        self._rate: dict[int, np.ndarray] = {}
        self._edges, self._events, self._done = no_edges(), [], -np.inf
        self._change, self._weight = np.zeros((2, self._n_slot, self.height * self.width)), 0.0

    def add(self, piece: CameraRecording) -> None:
        """Add what has come."""
        events, edges = piece.events, piece.edges
        times = [t[[0, -1]] for t in (events.t, edges.t) if len(t)]
        if not times:
            return
        self.first_us = min(t[0] for t in times) if self.first_us is None else self.first_us
        self.last_us = max(t[1] for t in times)
        self.n_event += len(events)
        self._count(events)
        pairs = ((getattr(self._edges, name), getattr(edges, name)) for name in ("p", "t", "id"))
        self._edges = Edges(*(np.concatenate(pair)[-MOST_EDGES:] for pair in pairs))
        self._events.append(events)
        self._close_rounds()

    @property
    def triggers(self) -> Triggers | None:
        """Give the starts of rounds, as `rounds.find_triggers`."""
        return find_triggers(self._edges, self.round_us)

    @property
    def n_edge(self) -> int:
        """Count the rising edges, of all inputs."""
        return int(np.count_nonzero(self._edges.p == 1))

    def rate(self) -> tuple[np.ndarray, np.ndarray]:
        """Give OFF and ON events (2, n) of each of the last `N_RATE` times `RATE_US`, and when each began [us]."""
        last = max(self._rate, default=0)
        first = max(min(self._rate, default=0), last - N_RATE + 1)
        index = np.arange(first, last + 1)
        nothing = np.zeros(2, np.int64)
        return np.stack([self._rate.get(k, nothing) for k in index], 1), index * RATE_US

    def levels(self) -> tuple[np.ndarray, np.ndarray]:
        """Give log light (n_slot, height, width) as the LED of each slot alone is lit, and where events came (height, width).

        In thresholds of ON events, from the mean of a round: the sum of events, of which OFF count so much that both
        cancel, as `leds.levels`.
        """
        off, on = self._change / max(self._weight, 1)
        ratio = on.sum(0) / np.maximum(off.sum(0), 1e-9)
        level = np.cumsum(on - ratio * off, axis=0)
        shape = self.height, self.width
        both = (on.sum(0) > 0) & (off.sum(0) > 0)
        return (both * (level - level.mean(0))).reshape(-1, *shape), both.reshape(shape)

    def _count(self, events: Events) -> None:
        """Count over time."""
        index, place = np.unique(events.t // RATE_US, return_inverse=True)
        count = np.bincount(2 * place + events.p, minlength=2 * len(index)).reshape(-1, 2)
        for k, more in zip(index.tolist(), count):
            self._rate[k] = self._rate.get(k, 0) + more
        for k in sorted(self._rate)[:-N_RATE]:
            del self._rate[k]

    def _close_rounds(self) -> None:
        """Add up the rounds that have ended, and let their events go."""
        found = self.triggers
        edge = np.empty(0, np.int64) if found is None else found.edge_us
        fits = np.abs(np.diff(edge) / self.round_us - 1) < ON_GRID
        news = np.flatnonzero(fits & (edge[1:] > self._done))
        if len(news) or sum(map(len, self._events)) > MOST_EVENTS:
            self._events = [_joined(self._events)]
        for k in news:
            begin, self._done = edge[k], edge[k + 1]
            self._add_round(between(self._events[0], begin, self._done), begin, self._done)
            self._events = [between(self._events[0], self._done, np.inf)]

    def _add_round(self, events: Events, begin: float, end: float) -> None:
        """Add the events of a round, by place and slot."""
        n_slot, shape = self._n_slot, self._change.shape
        at = (events.t - begin) / (end - begin) * n_slot
        slot = np.minimum(at.astype(np.int64), n_slot - 1)
        knot = np.ceil(at - (1 - self.schedule.crossfade)).astype(np.int64) % n_slot
        p, (row, column) = events.p.astype(np.int64), (np.int64(c) // self.step for c in (events.y, events.x))
        place = row * self.width + column
        count = np.bincount((p * n_slot + knot) * shape[2] + place, minlength=self._change.size)
        self._change, self._weight = KEPT * self._change + count.reshape(shape), KEPT * self._weight + 1
        self.per_slot = np.bincount(p * n_slot + slot, minlength=2 * n_slot).reshape(2, n_slot)
        alone = (events.x % self.step == 0) & (events.y % self.step == 0)  # one of each pixel of the picture
        cell, sign = (slot * shape[2] + place)[alone], (2 * p - 1)[alone]
        count = np.bincount(cell)
        several = count > 1
        if several.any():
            self.agree = float(np.abs(np.bincount(cell, sign)[several]).sum() / count[several].sum())
        self.n_round += 1


def _joined(parts: list[Events]) -> Events:
    """Join events, the newest of them."""
    names = ("x", "y", "p", "t")
    return Events(*(np.concatenate([getattr(part, name) for part in parts])[-MOST_EVENTS:] for name in names))
