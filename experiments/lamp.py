"""A recording of a ring while a lamp on the mains shines: `evsdr.record` knows only a constant light."""

import numpy as np

import evsdr
from evsdr.events.simulator import simulate_events

STEPS = 16  # of a slot, between which light is linear


def under_a_lamp(
    signal: np.ndarray,
    constant_light: float,
    schedule: evsdr.Schedule,
    hz: float,
    rounds: int = 4,
    share: float = 0.8,
    depth: float = 0.3,
    pixel: evsdr.EventPixel = evsdr.EventPixel(),
) -> evsdr.Recording:
    """Record the light (n_led, height, width) of a ring while a share of the constant light goes up and down.

    Parameters
    ----------
    signal : (n_led, height, width) float
    constant_light : float
        Mean.
    schedule : Schedule
        With LEDs that fade all the while, and no dark slots.
    hz : float
        How often a second.
    rounds : int
    share, depth : float
        Of the constant light that does, and how far.
    pixel : EventPixel
    """
    turn = np.arange(len(schedule.order) * rounds * STEPS) / STEPS
    slot = turn.astype(int) % len(schedule.order)
    now, following = (signal[order[slot]] for order in (schedule.order, np.roll(schedule.order, -1)))
    fade = (turn % 1)[:, None, None]
    lamp = share * constant_light * (1 + depth * np.sin(2e-6 * np.pi * hz * turn * schedule.slot_us))
    light = ((1 - fade) * now + fade * following + lamp[:, None, None]).astype(np.float32)
    fine = evsdr.Schedule(np.arange(len(light), dtype=np.int32), schedule.slot_us / STEPS, 1.0)
    events, on, off, ends = simulate_events(light, (1 - share) * constant_light, fine, 1, pixel)
    starts = np.linspace(ends[0], ends[-1], rounds + 1).astype(np.int64)
    sensor = evsdr.Sensor(signal.shape[2], signal.shape[1], on, off, pixel.refractory_us)
    return evsdr.Recording(events, sensor, schedule, starts)
