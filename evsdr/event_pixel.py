"""Event pixels under the ring's light, with exact crossing times.

The light I(t) of a pixel follows the schedule (see `ring_light`). With everything real on, a pixel obeys

    tau dv/dt = log I - v,      1 / tau = 2 pi cutoff_hz I            photoreceptor, slower in the dark
    q(t) = v(t) + noise(t) - reference + leak (t - t_ref)             what the comparators see

and fires at q = +C_on or q = -C_off. When the refractory period is over, the reference is memorised anew and
the leak starts again at t_ref. Without a photoreceptor v = log I.

The noise is the photo-electrons' shot noise, white in log I with density 1 / (photon_rate I), behind the same
photoreceptor. Cutoff and density both follow I, so its standard deviation sqrt(pi cutoff / photon_rate) is the
same in all light.

Time goes in steps in which log I, v and the leak change by CHANGE at most together. In a step log I is taken
as linear in the photoreceptor's own time, integral dt / tau, in which its answer is an exact exponential; the
noise is an exact Ornstein-Uhlenbeck step of at most NOISE_STEP tau near a threshold (longer where the noise
can't reach it), and linear inside. Crossings inside a step are found to rounding error. Without photoreceptor
log I itself is exact at any time; without leak and rise time too, steps span whole ramps and crossings are a
closed form.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from evsdr.errors import InputError
from evsdr.records import Events, Schedule

SPREAD_CORRELATION = -0.21  # between the fixed patterns of C_on and C_off, measured on 921,600 pixels
SMALLEST_THRESHOLD = 0.02  # a fixed pattern or its noise goes no lower
SMALLEST_LIGHT = 1e-6  # darkness, so that the logarithm stays finite
CHANGE = 0.05  # of log intensity in a step
MIN_STEP_US = 1e-3
NOISE_STEP = 0.5  # of the photoreceptor's time constant
FAR = 8.0  # standard deviations that the noise does not cross
CROSSING_TOLERANCE = 1e-12  # of log intensity
BLOCK = 4096  # pixels between two looks at the keyboard
ROOM = 256  # events of a pixel before it is done again with more room


@dataclass(frozen=True)
class EventPixel:
    """An event pixel; the defaults are an EVK4 (IMX636) at default biases.

    Attributes
    ----------
    contrast_threshold_on, contrast_threshold_off : float
        Change of natural log intensity that fires an event; 0.02 at least.
    spread_on, spread_off : float
        Standard deviation of the fixed, spatially white pattern added to each threshold.
    event_noise : float
        Relative standard deviation of the thresholds from one event to the next.
    refractory_us : float
        Time after an event until the reference is memorised anew [us].
    cutoff_hz : float
        Cutoff of the photoreceptor at I = 1 [Hz], proportional to I; 0 for none. The default lags by 53 us
        there and by 660 us at I = 0.08.
    photon_rate_per_us : float
        Photo-electrons at I = 1 [1/us]; 0 for no shot noise. The default makes noise of 0.01 behind the
        photoreceptor, 1/26 of the threshold: times jitter, and only the few pixels with the lowest thresholds
        fire in steady light.
    leak_hz : float
        ON events of a pixel at rest [Hz].
    hot_fraction, hot_hz : float
        Share of pixels that leak more, and how much [Hz].

    Raises
    ------
    InputError
        A value makes no sense.
    """

    contrast_threshold_on: float = 0.2525
    contrast_threshold_off: float = 0.3795
    spread_on: float = 0.049
    spread_off: float = 0.039
    event_noise: float = 0.02
    refractory_us: float = 52.0
    cutoff_hz: float = 3000.0
    photon_rate_per_us: float = 100.0
    leak_hz: float = 0.1
    hot_fraction: float = 1e-4
    hot_hz: float = 1000.0

    @classmethod
    def ideal(cls, threshold: float = 0.25, refractory_us: float = 52.0) -> "EventPixel":
        """Give a pixel without spread, noise, lag and leak."""
        off = {field.name: 0.0 for field in fields(cls)[2:]}
        return cls(threshold, threshold, **(off | {"refractory_us": refractory_us}))

    def __post_init__(self):
        for field in fields(self):
            value = getattr(self, field.name)
            smallest = SMALLEST_THRESHOLD if field.name.startswith("contrast") else 0
            if not smallest <= value < np.inf:
                raise InputError(f"{field.name} is {value:g}; give a number of {smallest:g} or more.")
        if self.hot_fraction > 1:
            raise InputError(f"hot_fraction is {self.hot_fraction:g}; give a share of the pixels, 0 to 1.")
        if self.photon_rate_per_us > 0 and self.cutoff_hz == 0:
            raise InputError(
                "photon_rate_per_us makes noise without bounds when cutoff_hz is 0; "
                "set photon_rate_per_us to 0 too, or give a cutoff."
            )


class _Model(NamedTuple):
    """What all pixels share; rates per us."""

    n_round: int
    slot_us: float
    crossfade: float
    led_rise_us: float
    led_rate: float  # 1 / led_rise_us, or 0
    cutoff: float  # 1 / tau at I = 1, or 0
    noise: float  # standard deviation of the shot noise behind the photoreceptor
    event_noise: float
    refractory_us: float


class _Step(NamedTuple):
    """A step of `length` us from x = 0: I(x) = flat + slope x + transient exp(-led_rate x), and its log."""

    length: float
    flat: float
    slope: float
    transient: float
    led_rate: float
    cutoff: float
    light: float
    light_gain: float
    log_light: float
    log_gain: float
    lagged: float  # v at x = 0
    noise: float
    noise_gain: float


@dataclass(frozen=True)
class Crossings:
    """Events before their times are rounded, each pixel's own in time order.

    Attributes
    ----------
    pixel : (n_event,) int32
        y * width + x.
    polarity : (n_event,) int8
        +1 or -1.
    t_us : (n_event,) float64
        Time since the start of the schedule [us].
    """

    pixel: np.ndarray
    polarity: np.ndarray
    t_us: np.ndarray


def simulate_events(
    signal: np.ndarray,
    constant_light: float,
    schedule: Schedule,
    n_round: int,
    pixel: EventPixel,
    seed: int = 0,
    led_rise_us: float = 0.0,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Events, np.ndarray, np.ndarray, np.ndarray]:
    """Simulate the events of a ring that runs for some rounds.

    The reference is memorised at `schedule.start_us`, with the first LED fully lit. The same seed gives the
    same events, whatever the number of threads.

    Parameters
    ----------
    signal : (n_led, height, width) float
        A_xj, 0 or more; a white patch that faces an LED has 1.
    constant_light : float
        C_w; the whole light is taken as 1e-6 where it is less.
    schedule : Schedule
        Which LED is lit when.
    n_round : int
        Number of rounds.
    pixel : EventPixel
        The event pixel.
    seed : int
        Of the fixed patterns and of all noise.
    led_rise_us : float
        Time constant of each LED's light [us].
    progress : callable(done, total), optional
        Called with numbers of pixels now and then.

    Returns
    -------
    events : Events
        Sorted by time, then by pixel; times rounded to the nearest us. The pixel itself runs on exact times.
    threshold_on, threshold_off : (height, width) float32
        Contrast thresholds with their fixed pattern.
    round_start_us : (n_round + 1,) int64
        Starts of the rounds and end of the last [us].

    Raises
    ------
    InputError
        An argument can't be used.
    """
    _check(signal, constant_light, schedule, n_round, seed, led_rise_us)
    height, width = signal.shape[1:]
    threshold_on, threshold_off, leak, state = _pixel_maps(pixel, height, width, seed)
    crossings = find_crossings(
        signal, constant_light, schedule, n_round, pixel, threshold_on, threshold_off, leak, state, led_rise_us, progress
    )
    start = np.arange(n_round + 1) * (schedule.slot_us * len(schedule.order)) + schedule.start_us
    t = np.rint(crossings.t_us + schedule.start_us).astype(np.int64)
    # One integer per event sorts by time, then pixel; a pixel's own events stay in order.
    since = t - int(np.floor(schedule.start_us))
    order = np.argsort(since * (height * width) + crossings.pixel, kind="stable")
    y, x = np.divmod(crossings.pixel[order], width)
    p = (crossings.polarity[order] > 0).astype(np.int8)
    events = Events(x.astype(np.uint16), y.astype(np.uint16), p, t[order])
    return events, threshold_on, threshold_off, np.rint(start).astype(np.int64)
