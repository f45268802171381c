"""What a user tells of a ring without a log: completed by what the recording holds, it stands for ring.json."""

from dataclasses import dataclass

import numpy as np

from evsdr.errors import InputError
from evsdr.files.events_h5 import LARGEST_LED
from evsdr.rig.camera_file import CameraRecording
from evsdr.rig.log import RingLog
from evsdr.rig.rounds import Edge, choose_input

MOST_ROUNDS = 10**6


@dataclass(frozen=True)
class ToldRing:
    """What is told of a ring.

    Attributes
    ----------
    order : tuple of int
        LED of each slot of a round, -1 for none.
    slot_us : float, optional
        Length of a slot [us]; None to take it from the triggers.
    crossfade : float
        Fraction of a slot's end over which an LED fades into the next, 0..1.
    n_round : int, optional
        Rounds; None to count them.
    """

    order: tuple[int, ...]
    slot_us: float | None = None
    crossfade: float = 1.0
    n_round: int | None = None

    def __post_init__(self):
        if not self.order or min(self.order) < -1 or not 0 <= max(self.order) <= LARGEST_LED:
            raise InputError(f"--order must name the LED of each slot, 0 to {LARGEST_LED}, -1 for none.")
        if self.slot_us is not None and not 0 < self.slot_us < np.inf:
            raise InputError(f"--slot-us is {self.slot_us:g}; give a time above 0.")
        if not 0 <= self.crossfade <= 1:
            raise InputError(f"--crossfade is {self.crossfade:g}; give a number from 0 to 1.")
        if self.n_round is not None and not 1 <= self.n_round <= MOST_ROUNDS:
            raise InputError(f"--rounds is {self.n_round}; give a whole number from 1 to {MOST_ROUNDS}.")


def complete(
    told: ToldRing,
    camera: CameraRecording,
    edge: Edge = "rising",
    trigger_id: int | None = None,
    start_us: float | None = None,
) -> RingLog:
    """Give the log that a ring would have written.

    Parameters
    ----------
    told : ToldRing
        What is told; triggers at the start of each round tell the length of a slot and the rounds, else.
    camera : CameraRecording
        The recording.
    edge : "rising" or "falling"
        Which edge of a pulse marks the start of a round.
    trigger_id : int, optional
        Trigger input of the round starts.
    start_us : float, optional
        Start of the first round [us], instead of triggers.

    Raises
    ------
    InputError
        Both together tell too little.
    """
    n_slot, slot_us, n_round = len(told.order), told.slot_us, told.n_round
    if start_us is None:
        _, t = choose_input(camera.edges, n_round, edge, trigger_id)
        if len(t) < 2:
            raise InputError(
                "it has a single trigger edge, which tells no round; give --start-us and --slot-us."
            )
        slot_us = slot_us or float(np.median(np.diff(t))) / n_slot
        first, last = t[[0, -1]]
    elif slot_us is None:
        raise InputError("without triggers nothing tells how long a slot is; give --slot-us.")
    else:
        first, last = start_us, float(camera.events.t[-1])
    if n_round is None:
        turns = (last - first) / (n_slot * slot_us)
        n_round = min(round(turns) if start_us is None else int(max(turns, 0)), MOST_ROUNDS)
    if n_round < 1:
        raise InputError(
            f"no round of {1e-3 * n_slot * slot_us:.6g} ms fits between {1e-6 * first:.3f} s and {1e-6 * last:.3f} s; "
            "check --order, --slot-us and --start-us."
        )
    order = np.array(told.order, np.int32)
    return RingLog(order, slot_us, told.crossfade, n_round, "done", source="what you tell of the ring")
