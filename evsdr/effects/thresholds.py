"""Whether contrast thresholds are taken as told or are unknown."""

from dataclasses import replace

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.world import Fitted, World


class Thresholds:
    """Contrast thresholds that are unknown, pixel by pixel."""

    name, option, when = "contrast thresholds", "thresholds", "scene"

    def decide(self, asked: str, world: World, fitted: Fitted | None) -> Decision:
        """Estimate them where the recording tells one value for all, and the solver can."""
        sensor = world.recording.sensor
        if asked == "known":
            return self._as_told("asked for by --thresholds known")
        if world.terms.solver == "adam":
            return self._as_told("the solver adam does not estimate them")
        if world.ring.constant_light == 0:
            return self._as_told("without constant light they can't be told from the contrast")
        if asked == "estimate":
            why = "asked for by --thresholds estimate"
        elif np.ndim(sensor.contrast_threshold_on) or np.ndim(sensor.contrast_threshold_off):
            return self._as_told("the recording holds those of each pixel")
        else:
            why = "the recording tells one value for all"
        return Decision(self.name, True, f"estimated per pixel: {why}")

    def _as_told(self, why: str) -> Decision:
        return Decision(self.name, False, f"as told: {why}")

    def model(self, world: World, decision: Decision) -> World:
        """Make them unknowns of the solver."""
        return replace(world, thresholds=True)
