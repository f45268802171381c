"""A recording: what event pixels make of the ring's light."""

from dataclasses import replace

import numpy as np

from evsdr.events.pixel import simulate_events
from evsdr.records import Recording, Schedule, Sensor

IDEAL = dict(
    spread_on=0.0,
    spread_off=0.0,
    cutoff_hz=0.0,
    photon_rate_per_us=0.0,
    leak_hz=0.0,
    hot_fraction=0.0,
    hot_hz=0.0,
)


def record(signal: np.ndarray, constant_light: float, options, progress=None) -> Recording:
    """Let event pixels watch the ring go round."""
    n_led, height, width = signal.shape
    order = np.arange(n_led) if options.order is None else options.order
    schedule = Schedule(np.asarray(order, np.int32), options.slot_us, options.crossfade)
    pixel = replace(options.pixel, **IDEAL) if options.ideal else options.pixel
    events, on, off, round_start_us = simulate_events(
        signal,
        constant_light,
        schedule,
        options.rounds,
        pixel,
        seed=options.seed,
        led_rise_us=options.led_rise_us,
        progress=progress and (lambda done, total: progress("", done / total)),
    )
    if options.thresholds == "nominal" or pixel.spread_on == pixel.spread_off == 0:
        on, off = pixel.contrast_threshold_on, pixel.contrast_threshold_off
    return Recording(events, Sensor(width, height, on, off, pixel.refractory_us), schedule, round_start_us)
