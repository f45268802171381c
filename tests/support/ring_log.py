"""The log of a ring that ran for five rounds, and its trigger pulses."""

import numpy as np

from evsdr.rig.camera_file import Edges

ORDER, SLOT_US, N_ROUND = [0, 2, -1, 1], 2500.0, 5
ROUND_US = 10_000
LOG = {
    "format": "evsdr ring log",
    "version": 1,
    "firmware": "1.0",
    "order": ORDER,
    "slot_us": SLOT_US,
    "crossfade": 0.75,
    "rounds": N_ROUND,
    "rounds_done": N_ROUND,
    "trim": [1.0] * 24,
    "constant_light": True,
    "sync_slots": False,
    "started_utc": "2025-05-01T10:00:00Z",
    "log": [[0.0, "armed"]],
    "ended": "done",
}
STARTS = 7000 + ROUND_US * np.arange(N_ROUND + 1)


def pulses(starts, trigger_id=0, length=200, low=False) -> Edges:
    """Give a pulse at each start."""
    starts = np.asarray(starts, np.int64)
    t = np.stack([starts, starts + length], axis=1).ravel()
    p = np.tile([0, 1] if low else [1, 0], len(starts)).astype(np.int8)
    return Edges(p, t, np.full(len(t), trigger_id, np.int16))
