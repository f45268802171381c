"""Whether contrast thresholds are taken as told or are unknown."""

from dataclasses import replace

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.shared import SharedEffect, SharedFound
from evsdr.effects.world import Fitted, World


class Thresholds:
    """Contrast thresholds that are unknown, pixel by pixel."""

    name, option, when = "contrast thresholds", "thresholds", "scene"

    def decide(self, asked: str, world: World, fitted: Fitted | None) -> Decision:
        """Estimate them where the recording tells one value for all, or measured ones, and the solver can."""
        sensor = world.recording.sensor
        if asked == "known":
            return self._as_told("asked for by --thresholds known")
        if world.terms.solver == "adam":
            return self._as_told("the solver adam does not estimate them")
        if world.ring.constant_light == 0 and world.veil is None:
            return self._as_told("without constant light they can't be told from the contrast")
        if asked == "estimate":
            why = "asked for by --thresholds estimate"
        elif not (np.ndim(sensor.contrast_threshold_on) or np.ndim(sensor.contrast_threshold_off)):
            why = "the recording tells one value for all"
        elif sensor.contrast_threshold_tolerance:
            why = f"those of the recording were measured to {sensor.contrast_threshold_tolerance:.1%}"
        else:
            return self._as_told("the recording holds those of each pixel")
        return Decision(self.name, True, f"estimated per pixel: {why}")

    def _as_told(self, why: str) -> Decision:
        return Decision(self.name, False, f"as told: {why}")

    def model(self, world: World, decision: Decision) -> World:
        """Make them unknowns of the solver."""
        return replace(world, thresholds=True)


class ThresholdsUnderVeil(Thresholds):
    """The same once the events have shown constant light."""

    when = "anew"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Ask again only then."""
        return None if world.veil is None else super().decide(asked, world, fitted)


CLEAR = 0.05  # of a logarithm; measured: where noise is another than the model's, thresholds told right are found 0.02 off


class ThresholdScale(SharedEffect):
    """Thresholds that are told pixel by pixel, but all of them too high or too low."""

    name, group = "scale of contrast thresholds", "thresholds"

    def is_clear(self, found: SharedFound) -> bool:
        """Look at the larger difference."""
        return float(np.abs(found.inferred.rig.log_threshold).max()) > CLEAR

    def decide(self, asked, world: World, fitted: Fitted) -> Decision | None:
        """Ask only where thresholds are not unknown anyway."""
        return None if world.thresholds else super().decide(asked, world, fitted)

    def say(self, found: SharedFound) -> str:
        """Give both factors."""
        on, off = np.exp(found.inferred.rig.log_threshold)
        return f"{on:.3g} times the told C_on, {off:.3g} times the told C_off"

    def numbers(self, found: SharedFound) -> dict:
        """Give them in numbers."""
        factor = np.exp(found.inferred.rig.log_threshold)
        sigma = factor * found.inferred.sigma.log_threshold
        return {"threshold_factor": factor.tolist(), "threshold_factor_sigma": sigma.tolist()}

    def model(self, world: World, decision: Decision) -> World:
        """Multiply them."""
        on, off = np.exp(decision.answer.inferred.rig.log_threshold)
        sensor = world.recording.sensor
        sensor = replace(
            sensor,
            contrast_threshold_on=sensor.contrast_threshold_on * on,
            contrast_threshold_off=sensor.contrast_threshold_off * off,
        )
        return replace(world, recording=replace(world.recording, sensor=sensor))
