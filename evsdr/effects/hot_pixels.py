"""Hot pixels: those that fire more events than any light can make them."""

from dataclasses import replace

import drjit as dr
import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.world import Fitted, World
from evsdr.events.chosen import count_events
from evsdr.model.illumination import Illumination
from evsdr.records import Recording


def impossible_rate(recording: Recording, light: Illumination) -> np.ndarray:
    """Tell which pixels (height, width) fire more events than any surface under this ring can make them.

    From darkness to the brightest LED on a white surface log I grows by log(1 + E / C_w); no pixel sees that much in
    every slot.
    """
    sensor, schedule = recording.sensor, recording.schedule
    events, starts = recording.events, recording.round_start_us
    brightest = max(float(dr.max(e)[0]) for e in light.irradiance)
    lowest = min(np.min(sensor.contrast_threshold_on), np.min(sensor.contrast_threshold_off))
    veil = max(float(light.constant_light[0]), 1e-6 * brightest)
    per_slot = 1 + np.log1p(brightest / veil) / lowest
    duration = starts[-1] - starts[0] if len(starts) > 1 else np.ptp(events.t)
    count = count_events(events, (sensor.height, sensor.width))
    return count > per_slot * (duration / schedule.slot_us + 1)


class HotPixels:
    """Pixels whose events and silences count for nothing."""

    name, option, when = "hot pixels", "", "scene"

    def decide(self, asked: str, world: World, fitted: Fitted | None) -> Decision:
        """Count the events of each pixel."""
        hot = impossible_rate(world.recording, world.illumination())
        n = int(np.count_nonzero(hot & world.mask))
        if n == 0:
            return Decision(self.name, False, "none: no pixel fires more events than any light can make")
        why = f"{n}, whose events count for nothing: they fire more than any light can make them"
        return Decision(self.name, True, why, found={"pixels": n}, answer=hot)

    def model(self, world: World, decision: Decision) -> World:
        """Leave out what they say."""
        return replace(world, hot=decision.answer)
