"""What of the sensor is taken as told and what is estimated, and why."""

from dataclasses import replace

import numpy as np

from evsdr.problem import Observations
from evsdr.records import Recording
from evsdr.refractory import find_refractory
from evsdr.scene import RingScene
from evsdr.shading import Illumination


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


def choose_refractory(
    asked: str, seen: Observations, light: Illumination, thresholds: bool
) -> tuple[Observations, dict]:
    """Decide which refractory period counts, and say why.

    Parameters
    ----------
    asked : str
        `known`, `estimate` or `auto`.
    seen : Observations
    light : Illumination
        What the LEDs send to the pixels.
    thresholds : bool
        Whether contrast thresholds are unknown, too.

    Returns
    -------
    seen : Observations
        Paired by the period that counts.
    report : dict
        Periods told and found [us], for the summary.
    """
    sensor = seen.recording.sensor
    told = None if "refractory_us" in sensor.guessed else sensor.refractory_us
    report = {"told_us": told, "found_us": None}
    if asked == "known" or (asked == "auto" and told is not None):
        return seen, report
    found = find_refractory(seen.recording, seen.under(light), thresholds)
    if found is None:
        return seen, report
    corrected = replace(seen.recording, sensor=replace(sensor, refractory_us=found[0]))
    return seen.corrected(corrected), report | {"found_us": found[0], "sigma_us": found[1]}


def looks_for_lag(options) -> tuple[bool, str]:
    """Decide whether to ask the events how late they are, and say why not."""
    if options.lag == "off":
        return False, "not modelled: asked for by --lag off"
    if options.solver != "lm" or options.preset == "fast":
        return False, f"not looked for by the {'preset fast' if options.solver == 'lm' else 'solver adam'}"
    return True, "not modelled: the events show none"
