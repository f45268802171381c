"""A white patch under the ring, for tests of calibrations."""

from dataclasses import replace

import numpy as np

from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.records import Recording, Schedule, Sensor

LIGHT, WHITE, SIDE = 0.05, 0.99, 6


QUIET = EventPixel().idealised()


NOISY = replace(QUIET, spread_on=0.02, spread_off=0.02)


WITH_DARK = tuple(k for j in range(24) for k in (j, -1))


def tilt(polar_deg: float, azimuth_deg: float) -> np.ndarray:
    polar, azimuth = np.radians([polar_deg, azimuth_deg])
    return np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])


TILTS = [tilt(10, 0), tilt(30, 0), tilt(30, 120), tilt(30, 240)]


def record_patch(
    direction, power, normal, order, seed, rounds=1, pixel=NOISY, shape=(SIDE, SIDE)
) -> Recording:
    """Let pixels look at a flat patch; a frame of one pixel around it stays dark."""
    signal = np.zeros((len(power), *shape))
    value = WHITE * power * np.maximum(direction @ normal, 0)
    signal[:, 1:-1, 1:-1] = value[:, None, None]
    schedule = Schedule(np.array(order, np.int32), 20_000.0, 1.0)
    events, on, off, starts = simulate_events(signal, LIGHT, schedule, rounds, pixel, seed)
    return Recording(events, Sensor(shape[1], shape[0], on, off, 52.0), schedule, starts)
