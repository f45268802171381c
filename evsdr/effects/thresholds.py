"""Whether contrast thresholds are taken as told or are unknown."""

import numpy as np

from evsdr.light.scene import RingScene
from evsdr.records import Recording


def choose_thresholds(asked: str, solver: str, recording: Recording, ring: RingScene) -> tuple[bool, str]:
    """Decide whether contrast thresholds are estimated, and say why.

    Parameters
    ----------
    asked : str
        `known`, `estimate` or `auto`.
    """
    told = recording.sensor.contrast_threshold_on, recording.sensor.contrast_threshold_off
    per_pixel = any(np.ndim(value) for value in told)
    if asked == "known":
        return False, "as told: asked for by --thresholds known"
    if solver == "adam":
        return False, "as told: the solver adam does not estimate them"
    if ring.constant_light == 0:
        return False, "as told: without constant light they can't be told from the contrast"
    if asked == "estimate":
        return True, "estimated per pixel: asked for by --thresholds estimate"
    if per_pixel:
        return False, "as told: the recording holds those of each pixel"
    return True, "estimated per pixel: the recording tells one value for all"
