"""Times that are late: light and events that do not share one start."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.shared import WARNED, SharedEffect, SharedFound, plus_minus

if TYPE_CHECKING:
    from evsdr.effects.world import World


class TimeShift(SharedEffect):
    """All events come late, or triggers early, by the same time."""

    name, group = "shift of all times", "shift"
    untold = "light without a lag does not tell it"

    def say(self, found: SharedFound) -> str:
        """Give the shift."""
        return f"events are {plus_minus(found.us('shift'))} late"

    def warning(self, found: SharedFound) -> str:
        """Give the shift, if it is more than triggers can be off."""
        shift, _ = found.us("shift")
        if abs(shift) <= WARNED * found.told.shift_us:
            return ""
        return f"events are {shift:.3g} us late against the triggers or start_us; check these."

    def numbers(self, found: SharedFound) -> dict:
        """Give it in numbers."""
        return dict(zip(("shift_us", "shift_sigma_us"), found.us("shift")))

    def model(self, world: "World", decision: Decision) -> "World":
        """Start rounds that much later."""
        recording, (shift, _) = world.recording, decision.answer.us("shift")
        schedule = replace(recording.schedule, start_us=recording.schedule.start_us + shift)
        starts = np.asarray(recording.round_start_us, float) + shift
        return replace(world, recording=replace(recording, schedule=schedule, round_start_us=starts))
