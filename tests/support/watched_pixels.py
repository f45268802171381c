"""Pixels under a ring of three LEDs whose signals are to be found, for tests of calibrations."""

import numpy as np

from evsdr.calibration.watched import Watched, watch
from evsdr.events.pixel import EventPixel
from evsdr.events.record import record, ring_schedule

LIGHT = 0.1
SIGNAL = np.array([0.9, 0.2, 0.6])
MASK = np.ones((10, 12), bool)
PIXEL = EventPixel(0.1, 0.15, event_noise=0.02).idealised()


def watched(pixel=PIXEL, seed=0, late_us=0, factor=1.0, one_value=False) -> Watched:
    """Record signals with a dark slot, or one ratio would be missing; thresholds told wrong by a factor, times late."""
    images = np.broadcast_to(np.reshape(SIGNAL, (-1, 1, 1)), (3, *MASK.shape))
    recording = record(images, LIGHT, pixel, ring_schedule(3, (0, -1, 1, 2), crossfade=1.0), 3, seed)
    sensor = recording.sensor
    told = [factor * c for c in (sensor.contrast_threshold_on, sensor.contrast_threshold_off)]
    if one_value:
        told = [factor * pixel.contrast_threshold_on, factor * pixel.contrast_threshold_off]
    sensor = type(sensor)(sensor.width, sensor.height, *told, sensor.refractory_us)
    events = type(recording.events)(
        *(getattr(recording.events, k) for k in "xyp"), recording.events.t + late_us
    )
    recording = type(recording)(events, sensor, recording.schedule, recording.round_start_us)
    return watch(recording, MASK, np.zeros(MASK.shape, int), 20_000, 0)


def unknown_signals(x):
    """Signals in units of the constant light: one unknown per LED, its logarithm."""
    signal = np.exp(x)[:, None]
    return signal, signal[..., None], np.zeros((len(x), 1, 0))


TRUTH = np.log(SIGNAL / LIGHT)
