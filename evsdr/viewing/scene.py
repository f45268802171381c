"""What a scene adds: a quick fit, whether anything in the files is told wrong, and how well maps can be known at best."""

import warnings
from dataclasses import dataclass

import numpy as np

from evsdr.errors import InputError, InputWarning
from evsdr.events.pixel import SMALLEST_THRESHOLD, EventPixel
from evsdr.fitting.entrance import Fit
from evsdr.fitting.settings import Settings
from evsdr.progress import Progress, Seconds, silent
from evsdr.records import Recording

N_PIXEL = 300  # on which the limit is computed: its median is then known to some percent
REPEATS = 2  # simulated recordings


@dataclass(frozen=True)
class Expected:
    """Smallest standard deviations, medians over pixels, if all that pixels share must be found, too.

    Attributes
    ----------
    normal_deg : float
        Of normals [deg].
    reflectance : float
        Of reflectances.
    """

    normal_deg: float
    reflectance: float


def quick_fit(ring, recording: Recording, progress: Progress = silent) -> Fit:
    """Fit a recording as fast as it goes, a large one in part; what its warnings say is in the verdict, too."""
    from evsdr.fitting.story import fit_recording

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        return fit_recording(
            ring, recording, Settings(preset="fast"), None, Seconds(progress), everywhere=False
        )


def expected_accuracy(ring, recording: Recording, found: Fit, n_round: int) -> Expected | None:
    """Give the limit of Cramer and Rao for the surface that was found, under this ring, schedule and sensor.

    None where no pixel tells anything.
    """
    from evsdr.light.tracing import trace_illumination
    from evsdr.limits.bound import find_limit
    from evsdr.limits.information import Plan

    known = np.flatnonzero(found.maps.mask)
    if not len(known) or n_round < 1:
        return None
    mask = np.zeros(found.maps.mask.shape, bool)
    mask.ravel()[known[:: -(-len(known) // N_PIXEL)]] = True
    illumination, _ = trace_illumination(ring, 1, True, 1)
    sensor = recording.sensor
    thresholds = (
        max(float(np.mean(getattr(sensor, f"contrast_threshold_{name}"))), SMALLEST_THRESHOLD)
        for name in ("on", "off")
    )
    pixel = EventPixel(*thresholds, refractory_us=sensor.refractory_us)
    plan = (found.maps.normal, found.maps.reflectance, mask, illumination, recording.schedule, n_round, pixel)
    try:
        bound = find_limit(Plan(*plan), repeats=REPEATS).unknown
    except InputError:
        return None
    return Expected(
        float(np.median(bound.normal_sigma_deg[mask])), float(np.median(bound.reflectance_sigma[mask]))
    )
