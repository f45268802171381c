"""An event pixel by other hands' physics, which shares no code with evsdr.events.

It goes through time in small steps, one pixel after the other, and has what published simulators have:

- ESIM (Rebecq, Gehrig, Scaramuzza 2018): log light that is linear between frames, a reference that moves by
  one threshold, events that are lost while a pixel rests;
- v2e (Hu, Liu, Delbruck 2021): a photoreceptor of one pole whose speed follows the light and a dark term,
  thresholds that differ from pixel to pixel, leak, noise events that are rarer in bright light;
- IEBCS (Joubert, Marcireau, Ralph, Jolley, van Schaik, Cohen 2021): latency with jitter, thresholds drawn
  anew at each event, a reference memorised when the pixel is reset, noise events by measured rates that reset
  it, read-out;
- DVS-Voltmeter (Lin, Ma, Guo, Wen 2022): Brownian motion with drift, events at its first passage;
- EventPS (Yu, Ren, Han, Wang, Liang, Shi 2024): thresholds with uniform noise.
"""

from typing import NamedTuple

import numpy as np

from tests.support.foreign_pixel_kernel import NEVER, read_out, run_pixels

STEP_US = 20.0  # longest step; a third of the photoreceptor's time at I = 1
FEWEST_STEPS = 200  # of a slot
US = 1e-6  # events per second to events per microsecond


class ForeignPixel(NamedTuple):
    """The physics of an event pixel, as numba reads it. Light I is in the unit of evsdr: 1 is a white patch.

    Attributes
    ----------
    on, off : float
        Contrast thresholds (natural log).
    mismatch_on, mismatch_off : float
        Standard deviation of the thresholds over the pixels, Gaussian.
    event_noise : float
        Relative standard deviation of a threshold from event to event.
    uniform : bool
        Whether that noise is uniform, else Gaussian.
    refractory_us : float
        How long a pixel rests after an event.
    steps : bool
        Whether the reference moves by one threshold; else it is memorised when the rest is over.
    drops : bool
        Whether a pixel that rests loses events while its reference moves on; else they come late.
    tau_us, lag_light : float
        Time constant of the photoreceptor, tau / (I + dark + lag); 0 for none.
    follower_us : float
        Time constant of a second pole, the same in any light.
    dark_light : float
        Dark current, as light: all of the pixel takes it for light.
    photons_per_us : float
        Photo-electrons at I = 1; 0 for no shot noise. It passes the poles.
    walk_shot, walk_floor : float
        Brownian motion of the log light, walk_shot sqrt(I) / (I + dark) + walk_floor [1 / sqrt(us)].
    leak_per_us, leak_of_light : float
        Drift of the log light [1/us], leak_per_us + leak_of_light I.
    noise_on_hz, noise_off_hz : float
        Noise events of a pixel, on average over the pixels.
    noise_spread : float
        Standard deviation of the log of that rate over the pixels.
    noise_at_white : float
        Share of that rate that is left at I = 1.
    noise_resets : bool
        Whether a noise event resets the pixel like any other.
    latency_us, jitter_us, delay_doubles_at : float
        How late an event leaves a pixel, and how much that varies, times 1 + delay_doubles_at / I.
    frame_us : float
        Log light is sampled so often and linear between; 0 for small steps.
    per_event_us, patience_us : float
        Time that an event holds the bus, which stamps it, and the wait from which it is lost.
    clock_us : int
        Step of the clock.
    """

    on: float = 0.25
    off: float = 0.25
    mismatch_on: float = 0.0
    mismatch_off: float = 0.0
    event_noise: float = 0.0
    uniform: bool = False
    refractory_us: float = 0.0
    steps: bool = False
    drops: bool = False
    tau_us: float = 0.0
    lag_light: float = 0.0
    follower_us: float = 0.0
    dark_light: float = 0.0
    photons_per_us: float = 0.0
    walk_shot: float = 0.0
    walk_floor: float = 0.0
    leak_per_us: float = 0.0
    leak_of_light: float = 0.0
    noise_on_hz: float = 0.0
    noise_off_hz: float = 0.0
    noise_spread: float = 0.0
    noise_at_white: float = 1.0
    noise_resets: bool = True
    latency_us: float = 0.0
    jitter_us: float = 0.0
    delay_doubles_at: float = 0.0
    frame_us: float = 0.0
    per_event_us: float = 0.0
    patience_us: float = NEVER
    clock_us: int = 1


KINDS = tuple(type(value) for value in ForeignPixel())


class ForeignEvents(NamedTuple):
    """Events in order of time (x, y, p 0 or 1, t), and the starts of rounds, by one clock [us]."""

    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    t: np.ndarray
    round_start_us: np.ndarray


def watch(
    signal: np.ndarray,
    constant_light: float,
    order: np.ndarray,
    slot_us: float,
    crossfade: float,
    n_round: int,
    pixel: ForeignPixel,
    seed: int = 0,
) -> ForeignEvents:
    """Let pixels watch a ring; `signal` (n_led, height, width) and the schedule are those of events.h5."""
    pixel = ForeignPixel(*(kind(value) for kind, value in zip(KINDS, pixel)))  # numba compiles for each kind
    n_led, height, width = signal.shape
    light = np.zeros((height * width, n_led + 1))
    light[:, :-1] = signal.reshape(n_led, -1).T
    random = np.random.default_rng([seed, 20220216])
    on = np.maximum(random.normal(pixel.on, pixel.mismatch_on, len(light)), 0.2 * pixel.on)
    off = np.maximum(random.normal(pixel.off, pixel.mismatch_off, len(light)), 0.2 * pixel.off)
    mean_one = np.exp(pixel.noise_spread * random.normal(size=len(light)) - 0.5 * pixel.noise_spread**2)
    rates = US * np.outer(mean_one, [pixel.noise_on_hz, pixel.noise_off_hz])
    n_step = _steps_of_a_slot(slot_us, pixel)
    ring = _ring(np.asarray(order, np.int64), crossfade, n_step, between=pixel.tau_us > 0)
    steps = slot_us / n_step, n_step * len(order) * n_round
    given = pixel, light, constant_light + pixel.dark_light, ring, *steps, on, off, rates, 1_000_003 * seed
    most = 512
    while True:
        out = np.empty((len(light), most, 2))
        count = run_pixels(*given, out)
        if count.max() <= most:
            break
        most = int(count.max())
    number = np.repeat(np.arange(len(light)), count)
    time, sign = out[np.arange(most) < count[:, None]].T
    order_of_time = np.argsort(time, kind="stable")
    number, sign = number[order_of_time], sign[order_of_time]
    stamp = read_out(time[order_of_time], pixel.per_event_us, pixel.patience_us)
    end = len(order) * slot_us * n_round
    kept = stamp < end
    round_start = len(order) * slot_us * np.arange(n_round + 1)
    stamp, round_start = (_by_clock(t, pixel.clock_us) for t in (stamp[kept], round_start))
    y, x = np.divmod(number[kept], width)
    return ForeignEvents(x, y, (sign[kept] > 0).astype(np.int8), stamp, round_start)


def _steps_of_a_slot(slot_us: float, pixel: ForeignPixel) -> int:
    if pixel.frame_us > 0:
        return max(round(slot_us / pixel.frame_us), 1)
    return max(int(np.ceil(slot_us / STEP_US)), FEWEST_STEPS)


def _ring(order: np.ndarray, crossfade: float, n_step: int, between: bool) -> tuple[np.ndarray, ...]:
    """Give two LEDs and the weight of the second, for the middles or the ends of the steps of a round."""
    slot, step = np.divmod(np.arange(len(order) * n_step) + (0 if between else 1), n_step)
    left = 1 - (step + 0.5 * between) / n_step  # of the slot
    fade = np.maximum(1 - left / crossfade, 0) if crossfade > 0 else np.zeros(len(left))
    return order[slot % len(order)], order[(slot + 1) % len(order)], fade


def _by_clock(t_us: np.ndarray, clock_us: int) -> np.ndarray:
    """Give the last tick of a clock before each time."""
    return (np.floor(t_us / clock_us) * clock_us).astype(np.int64)
