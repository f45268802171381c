"""One event pixel or a few under LEDs of given signals."""

import numpy as np

from evsdr.events.phase import weights
from evsdr.events.simulator import draw_pattern, find_crossings
from evsdr.records import Schedule

STEP_US = 0.25
CUTOFF = 2e-6 * np.pi * 3000  # 1 / tau at I = 1 and 3 kHz [1/us]


def ring(order, slot_us=300.0, crossfade=1.0, start_us=0.0) -> Schedule:
    return Schedule(np.array(order, np.int32), slot_us, crossfade, start_us)


def column(*signal) -> np.ndarray:
    """One pixel under LEDs of these signals, (n_led, 1, 1)."""
    return np.array(signal, np.float64)[:, None, None]


def run(signal, constant_light, schedule, n_round, pixel, seed=0, led_rise_us=0.0):
    """Exact times and polarities, pixel after pixel: (index, polarity, time) of each event."""
    fixed = draw_pattern(pixel, *signal.shape[1:], seed)
    found = find_crossings(signal, constant_light, schedule, n_round, pixel, fixed, led_rise_us)
    return found.pixel, found.polarity, found.t_us


def log_light(t_us, index, signal, constant_light, schedule):
    """log I at the times of events, straight from the signal model."""
    weight = weights(t_us, schedule, len(signal), np.empty(0, np.int64))
    return np.log(np.sum(weight * signal.reshape(len(signal), -1)[:, index].T, axis=1) + constant_light)
