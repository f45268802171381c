"""Find the rounds of the ring among the trigger edges that the camera saw.

The ring gives one edge at the start of each round and one at the end of the last, evenly spaced on its own
clock. Edges that lie on that grid are rounds; what is missing or too much is named, and mended only where the
grid leaves no doubt.
"""

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np

from evsdr.errors import InputError, InputWarning
from evsdr.events.period import root_mean_square, unevenness
from evsdr.rig.camera_file import Edges
from evsdr.rig.log import RingLog

CLOCK_TOLERANCE = 0.05  # of the ring's clock against the camera's; resonators are within 0.5 %
COUNTED = 0.1  # of a round, for an edge to be counted as the next ones; guessed
GRID_TOLERANCE = 0.005  # of a round, for an edge to lie on the grid; or, where edges jitter,
JITTERS = 10.0  # standard deviations, by few others, of that; guessed
JITTER_SLOTS = 0.01  # of that, worth a warning; guessed
OFF_GRID = np.iinfo(np.int64).min
BAD_CLOCK = 0.01  # difference of the clocks that is worth a warning

Edge = Literal["rising", "falling"]


@dataclass(frozen=True)
class Rounds:
    """The rounds on the camera's clock.

    Attributes
    ----------
    start_us : (n_round + 1,) int64
        Start of each round, and the end of the last [us].
    clock_ratio : float
        Time on the camera's clock per time on the ring's.
    jitter_us : float
        Standard deviation of an edge around where those beside it say [us].
    trigger_id : int
        Trigger input of the edges.
    """

    start_us: np.ndarray
    clock_ratio: float
    jitter_us: float
    trigger_id: int

    def __len__(self) -> int:
        return len(self.start_us) - 1


def find_rounds(edges: Edges, log: RingLog, edge: Edge = "rising", trigger_id: int | None = None) -> Rounds:
    """Find the rounds.

    Parameters
    ----------
    edges : Edges
        All that the camera saw.
    log : RingLog
        What the ring did.
    edge : "rising" or "falling"
        Which edge of a pulse marks the start of a round.
    trigger_id : int, optional
        Trigger input of the round starts; the one that fits if None.

    Raises
    ------
    InputError
        Edges and log don't belong together; the sentence doesn't name the file.

    Warns
    -----
    InputWarning
        The ring was stopped early; edges were missing or too many, and mended; the clocks differ; the other
        edge seems to be the true one.
    """
    trigger_id, t = choose_input(edges, log.n_round, edge, trigger_id)
    period = np.diff(t)
    even = np.abs(period / log.round_us - 1) < CLOCK_TOLERANCE
    if not even.any():
        seen = (
            f"the {edge} edges are {1e-3 * np.median(period):.6g} ms apart"
            if len(t) > 1
            else "one edge was seen"
        )
        raise InputError(
            f"a round of the ring takes {1e-3 * log.round_us:.6g} ms but on trigger input {trigger_id} "
            f"{seen}; check --trigger-id and --trigger-edge, and that {log.source} belongs to this recording."
        )
    index = _walk(t, int(even.argmax()), float(np.median(period[even])))
    on_grid = index != OFF_GRID
    index, first = np.unique(index[on_grid], return_index=True)  # of a doubled edge the first counts
    grid_t = t[on_grid][first]
    even, jitter = _even(index, grid_t, log.round_us)
    index, grid_t = index[even], grid_t[even]
    _check_count(log, grid_t, index, np.setdiff1d(t, grid_t), trigger_id)
    start = np.rint(np.interp(np.arange(index[0], index[-1] + 1), index, grid_t)).astype(np.int64)
    start = start[: log.n_round + 1]

    ratio = (start[-1] - start[0]) / ((len(start) - 1) * log.round_us)
    if abs(ratio - 1) > BAD_CLOCK:
        _warn(
            f"a round takes {ratio:.4f} times as long on the camera's clock as {log.source} says; "
            "the camera's time is used, but check slot_us."
        )
    _check_polarity(edges, trigger_id, edge, start)
    if jitter > JITTER_SLOTS * log.slot_us:
        _warn(
            f"the round starts jitter by {jitter:.0f} us on trigger input {trigger_id}, so a fit will even them out; "
            "take them from the ring's pin by a wire."
        )
    return Rounds(start, float(ratio), jitter, trigger_id)


def _even(index: np.ndarray, t: np.ndarray, round_us: float) -> tuple[np.ndarray, float]:
    """Tell which edges lie where those beside them say, (n,) bool, and how much these jitter."""
    kept = np.arange(len(t))
    while len(kept) > 4:
        worst = 1 + int(np.abs(unevenness(index[kept], t[kept])).argmax())
        others = np.delete(kept, worst)
        jitter = root_mean_square(unevenness(index[others], t[others]))
        off = abs(unevenness(index[kept], t[kept])[worst - 1])
        if off <= max(GRID_TOLERANCE * round_us, JITTERS * jitter):
            break
        kept = others
    return np.isin(np.arange(len(t)), kept), root_mean_square(unevenness(index[kept], t[kept]))


def _walk(t: np.ndarray, anchor: int, round_us: float) -> np.ndarray:
    """Count the rounds from the anchor to each edge, from edge to edge; OFF_GRID where they are not whole."""
    index = np.full(len(t), OFF_GRID)
    index[anchor] = 0
    for others in (range(anchor + 1, len(t)), range(anchor - 1, -1, -1)):
        last = anchor
        for i in others:
            turns = (t[i] - t[last]) / round_us
            whole = round(turns)
            if abs(turns - whole) < COUNTED:
                index[i] = index[last] + whole
                last = i if whole else last
    return index


def choose_input(
    edges: Edges, n_round: int | None, edge: Edge, trigger_id: int | None
) -> tuple[int, np.ndarray]:
    """Give the trigger input of the round starts and the times of its edges.

    Parameters
    ----------
    edges : Edges
        All that the camera saw.
    n_round : int, optional
        Rounds, by which one of several inputs is told.
    edge, trigger_id
        As for `find_rounds`.

    Raises
    ------
    InputError
        There is none, or several.
    """
    polarity = int(edge == "rising")
    inputs, counts = np.unique(edges.id[edges.p == polarity], return_counts=True)
    if not len(edges):
        raise InputError(
            "it holds no trigger edges; switch the camera's trigger input on and wire the ring to it, "
            "or give --start-us."
        )
    listed = ", ".join(f"input {i}: {n}" for i, n in zip(inputs, counts, strict=True)) or "none"
    if trigger_id is None and len(inputs) > 1:
        inputs = inputs[counts == (n_round or -1) + 1]
        if len(inputs) != 1:
            raise InputError(f"it has {edge} edges on several inputs ({listed}); give --trigger-id.")
    chosen = int(inputs[0]) if trigger_id is None and len(inputs) else trigger_id
    t = edges.t[(edges.p == polarity) & (edges.id == chosen)]
    if not len(t):
        other = np.count_nonzero(edges.p != polarity)
        raise InputError(
            f"it has no {edge} trigger edge where one is looked for ({edge} edges: {listed}; others: {other})"
            "; check --trigger-id and --trigger-edge."
        )
    return chosen, t


def _check_count(log: RingLog, t: np.ndarray, index: np.ndarray, stray: np.ndarray, trigger_id: int) -> None:
    """Refuse or name what is missing and what is too much; `index` is the round of each edge at t."""
    n_seen, n_told = int(index[-1] - index[0]), log.n_round
    where = f"trigger input {trigger_id}"
    missing = np.setdiff1d(np.arange(index[0], index[-1]), index) - index[0]
    stopped = log.ended != "done"
    fits = n_seen >= n_told if stopped else n_seen == n_told
    mendable = n_seen == n_told - 1 and n_seen > 0 and not len(stray) and not len(missing)
    if not fits and not mendable:
        raise InputError(
            f"{where} saw {n_seen} rounds from {1e-6 * t[0]:.3f} s to {1e-6 * t[-1]:.3f} s but the ring made "
            f"{n_told}; check that {log.source} belongs to this recording, and record the whole run."
        )
    if len(stray) > 2 * n_told or len(missing) > n_told // 2:
        raise InputError(
            f"{where} has {len(stray)} edges too many and {len(missing)} too few for {n_told} rounds; "
            "check its wiring and record again."
        )
    if stopped:
        _warn(f"the ring did not end its run ({log.ended}); its {n_told} complete rounds are used.")
    if not fits:
        _warn(f"{where} lacks the first or the last edge; the {n_seen} rounds between the others are used.")
    if len(stray):
        seconds = ", ".join(f"{1e-6 * s:.6f} s" for s in stray[:5])
        _warn(f"{where} has {len(stray)} edges that start no round (at {seconds}); they are left out.")
    if len(missing):
        numbers = ", ".join(str(k + 1) for k in missing[:5])
        _warn(f"{where} lacks the start of round {numbers}; it is put where the others say.")


def _check_polarity(edges: Edges, trigger_id: int, edge: Edge, start: np.ndarray) -> None:
    """Warn where the pulses begin with the other edge."""
    other = edges.t[(edges.id == trigger_id) & (edges.p == int(edge != "rising"))]
    before = np.searchsorted(other, start) - 1
    usable = (before >= 0) & (before + 1 < len(other))
    if not usable.any():
        return
    since = np.median(start[usable] - other[before[usable]])
    until = np.median(other[before[usable] + 1] - start[usable])
    if since < 0.2 * until:
        name = "falling" if edge == "rising" else "rising"
        _warn(
            f"the pulses on trigger input {trigger_id} begin with a {name} edge, {since:.0f} us before the "
            f"{edge} one that was used; if the trigger is active-{'low' if edge == 'rising' else 'high'}, "
            f"give --trigger-edge {name}."
        )


def _warn(sentence: str) -> None:
    warnings.warn(InputWarning(sentence), stacklevel=3)
