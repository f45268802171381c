"""Trigger edges: how regular they are, which are missing, which are too many."""

from dataclasses import dataclass

import numpy as np

from evsdr.rig.camera_file import Edges

ON_GRID = 0.02  # of a round, for an edge to be the start of one; as `events.phase.ROUND_TOLERANCE`
ANCHORS = 8  # edges from which the grid is tried


@dataclass(frozen=True)
class Triggers:
    """The starts of rounds.

    Attributes
    ----------
    edge_us : (n,) int64
        Edges on the grid.
    index : (n,) int64
        Round that each starts, the first is 0.
    round_us : float
        Time from one to the next [us].
    stray_us : (k,) int64
        Edges that lie between.
    deviation_us : (n,) float
        Distance from an even grid.
    """

    edge_us: np.ndarray
    index: np.ndarray
    round_us: float
    stray_us: np.ndarray
    deviation_us: np.ndarray

    @property
    def missing(self) -> np.ndarray:
        """Give the rounds, from 0, whose start has no edge."""
        return np.setdiff1d(np.arange(self.index[-1] + 1), self.index)

    @property
    def start_us(self) -> np.ndarray:
        """Give the start of each round, those that are missing put where the others say, and the end of the last."""
        every = np.arange(self.index[-1] + 1)
        return np.rint(np.interp(every, self.index, self.edge_us)).astype(np.int64)


def find_triggers(edges: Edges, told_us: float | None = None) -> Triggers | None:
    """Find the starts of rounds among the rising edges; None where fewer than two edges rise on one input.

    Parameters
    ----------
    edges : Edges
    told_us : float, optional
        How long a round lasts, as the schedule tells: of several inputs, the one that fits is taken.
    """
    found = []
    for number in np.unique(edges.id[edges.p == 1]):
        t = np.unique(edges.t[(edges.p == 1) & (edges.id == number)])
        if len(t) > 1:
            found.append(_on_grid(t, told_us))
    if not found:
        return None
    if told_us is None:
        return max(found, key=lambda f: len(f.edge_us))
    return min(found, key=lambda f: abs(np.log(f.round_us / told_us)))


def _on_grid(t: np.ndarray, told_us: float | None) -> Triggers:
    """Lay an even grid through edges at t, growing."""
    step = np.diff(t)
    near = np.abs(step / told_us - 1) < ON_GRID if told_us else np.zeros(len(step), bool)
    round_us = float(np.median(step[near] if near.any() else step))
    best = max((_fits(t, anchor, round_us) for anchor in t[:ANCHORS]), key=np.count_nonzero)
    edge = t[best]
    index = np.rint((edge - edge[0]) / round_us).astype(np.int64)
    index, first = np.unique(index, return_index=True)  # of a doubled edge the first counts
    edge = edge[first]
    if len(edge) < 2:
        return Triggers(edge, index, round_us, np.setdiff1d(t, edge), np.zeros(len(edge)))
    line = np.polynomial.Polynomial.fit(index, edge - edge[0], 1)
    every = float(line.convert().coef[1])
    return Triggers(edge, index, every, np.setdiff1d(t, edge), edge - edge[0] - line(index))


def _fits(t: np.ndarray, anchor: int, round_us: float) -> np.ndarray:
    """Tell which edges lie whole rounds from an anchor."""
    turns = (t - anchor) / round_us
    return np.abs(turns - np.rint(turns)) < ON_GRID
