"""Hot pixels: those that fire more events than any light can make them."""

import drjit as dr
import numpy as np

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
    number = events.y.astype(np.int64) * sensor.width + events.x
    count = np.bincount(number, minlength=sensor.height * sensor.width)
    return (count > per_slot * (duration / schedule.slot_us + 1)).reshape(sensor.height, sensor.width)
