"""What a fit looks at: observations of a recording, and what a fit makes of them."""

from dataclasses import dataclass, replace

import numpy as np

from evsdr.events.pairs import Pairs, pair_events
from evsdr.events.photoreceptor import Photoreceptors
from evsdr.model.illumination import Illumination
from evsdr.records import Maps, Recording
from evsdr.solve import levenberg
from evsdr.solve.problem import Problem, make_problem


@dataclass(frozen=True)
class Observations:
    """What a recording tells of the object's pixels, under whatever light.

    Attributes
    ----------
    recording : Recording
        For its events, sensor and schedule.
    mask : (height, width) bool
        Pixels to solve.
    pairs : Pairs
        Event pairs of all pixels.
    hot : (height, width) bool, optional
        Pixels whose events and silences count for nothing.
    """

    recording: Recording
    mask: np.ndarray
    pairs: Pairs
    hot: np.ndarray | None = None

    def under(self, light: Illumination) -> Problem:
        """Give the problem of these observations under a light."""
        return make_problem(self.recording, self.pairs, light, self.mask, self.hot)

    def corrected(self, recording: Recording) -> "Observations":
        """Pair the events of a recording that was put right."""
        return replace(self, recording=recording, pairs=pair_events(recording, self.mask))

    def behind(self, receptors: Photoreceptors) -> "Observations":
        """Pair the events anew, as seen through photoreceptors that lag."""
        return replace(self, pairs=pair_events(self.recording, self.mask, receptors))

    def in_order(self, order: np.ndarray) -> "Observations":
        """Take the LEDs to have shone in this order; which events are pairs does not depend on it."""
        schedule = replace(self.recording.schedule, order=order)
        return replace(self, recording=replace(self.recording, schedule=schedule))


@dataclass(frozen=True)
class Fitted:
    """One fit: the problem, its solution, and the maps it gives."""

    problem: Problem
    solution: levenberg.Solution
    maps: Maps
