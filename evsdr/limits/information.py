"""What the events of a ring tell of each pixel and of what all pixels share: Fisher information, before they fire.

Recordings are simulated with the sensor's noise, and the information of their events, at the true maps, is averaged.
It counts what the likelihood of first passage does (`solve.shared.kernel`): the threshold that each event met, the
density of its time, and that the other threshold was not met before. That an event comes only where the light goes
beyond an earlier extreme is left out: an edge of the density, which the inequality of Cramer and Rao does not cover.
"""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import SMALLEST_LIGHT, FixedPattern, draw_pattern, find_crossings
from evsdr.model.arrays import owned
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing
from evsdr.records import Schedule
from evsdr.solve.shared.kernel import Terms
from evsdr.solve.shared.pixels import Pixels
from evsdr.solve.shared.rig import N_TIMING, Rig
from evsdr.solve.unknowns import to_theta

# For the information of the pixels that are looked at at a time: 70 KB each under 24 LEDs, 5 MB under 256; guessed
BYTES = 1 << 27
GAUSSIAN = 1e6  # width of Cauchy's cost in standard deviations: that of a Gaussian
REPEATS = 4  # recordings: their mean is then known to some percent, sigma to half that


@dataclass(frozen=True)
class Plan:
    """A recording to be made.

    Attributes
    ----------
    normal : (height, width, 3) float
        True unit normals, camera frame.
    reflectance : (height, width, n_band) float
        True band reflectance.
    mask : (height, width) bool
        Pixels that count.
    light : Illumination
        What the LEDs send; arrays of width 1 or height * width.
    schedule : Schedule
        Which LED is lit when. Where LEDs switch hard the light passes many thresholds at once, and events tell less of
        the one that was met than is counted.
    n_round : int
        Number of rounds.
    pixel : EventPixel
        Leak and hot pixels are left out; its event noise, or its photoreceptor's, is above 0.
    """

    normal: np.ndarray
    reflectance: np.ndarray
    mask: np.ndarray
    light: Illumination
    schedule: Schedule
    n_round: int
    pixel: EventPixel

    @property
    def rig(self) -> Rig:
        """What pixels share, truly."""
        pixel, n_led = self.pixel, self.light.n_led
        tau = 1e6 / (2 * np.pi * pixel.cutoff_hz) if pixel.cutoff_hz else 0.0
        noise = np.sqrt(0.5 / (tau * pixel.photon_rate_per_us)) if pixel.photon_rate_per_us else 0.0
        tau, refractory = (t / self.schedule.slot_us for t in (tau, pixel.refractory_us))
        times = tau, 0.0, float(noise), 0.0, refractory, 0.0, 0.0
        return Rig(np.zeros(n_led), *times, np.zeros(2), np.zeros((n_led, 2)))

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation of the logarithms of both thresholds over the pixels (2,)."""
        pixel = self.pixel
        return np.array(
            [
                pixel.spread_on / pixel.contrast_threshold_on,
                pixel.spread_off / pixel.contrast_threshold_off,
            ]
        )


@dataclass(frozen=True)
class Information:
    """Fisher information; the n unknowns of a pixel are its maps, and the logarithms of its thresholds if they spread.

    Attributes
    ----------
    own : (n_pixel, n, n) float64
        Of its unknowns.
    cross : (n_pixel, n, m) float64
        Of those with the m that all pixels share, as `rig.Rig` orders them.
    shared : (m, m) float64
        Of these, of all pixels together.
    n_pair : (n_pixel,) float64
        Events that tell the threshold that they met.
    """

    own: np.ndarray
    cross: np.ndarray
    shared: np.ndarray
    n_pair: np.ndarray


def average_information(
    plan: Plan, repeats: int = REPEATS, seed: int = 0, tilted: bool = False
) -> Information:
    """Average the information of simulated recordings, of the pixels of the mask.

    Parameters
    ----------
    plan : Plan
    repeats : int
        Number of recordings, by the same sensor: its fixed pattern is that of `seed`, as `simulate_events` draws it.
    seed : int
    tilted : bool
        Whether directions of (far) LEDs are among what is shared; else their information is 0.
    """
    mask, pixel = plan.mask, replace(plan.pixel, leak_hz=0.0, hot_fraction=0.0)
    plan = replace(plan, pixel=pixel)
    pattern = draw_pattern(pixel, *mask.shape, seed)
    rng = np.random.default_rng((seed, 1))
    number, n = np.flatnonzero(mask), 4 + plan.light.n_band + N_TIMING + 3 * plan.light.n_led
    block = max(1, BYTES // (8 * n * n))
    states = rng.integers(0, 2**64, (repeats, len(number)), np.uint64)
    parts = [
        _of_block(plan, pattern, number[first : first + block], states[:, first : first + block], tilted)
        for first in range(0, len(number), block)
    ]
    own, cross, shared, n_pair = zip(*parts)
    return Information(np.concatenate(own), np.concatenate(cross), sum(shared), np.concatenate(n_pair))


def _of_block(
    plan: Plan, pattern: FixedPattern, number: np.ndarray, states: np.ndarray, tilted: bool
) -> tuple:
    """Give the parts of the information of some pixels, by their numbers; states (n_repeat, n) are those of their noise."""
    pixels, theta, rig = pixels_of(plan, number), theta_of(plan, number), plan.rig
    thresholds = [m.ravel()[number] for m in (pattern.threshold_on, pattern.threshold_off)]
    pixels = replace(pixels, threshold=np.stack(thresholds, axis=-1).astype(float))
    spreads = plan.spread.any()
    theta = np.column_stack([theta, np.zeros((len(theta), 2 * spreads))])
    signal, leak, n = pixels.signals(theta, rig)[:, 0].T, np.zeros(len(number)), theta.shape[1]
    matrix, n_pair = 0.0, np.zeros(len(number))
    for state in states:
        fixed = FixedPattern(*thresholds, leak, state)
        pixels = replace(pixels, events=_events(plan, pixels, signal, fixed))
        *_, information, residual, _ = information_of(
            pixels, theta, rig, plan.pixel.event_noise, spreads, tilted
        )
        matrix += information / len(states)
        told = np.append(0, np.cumsum(np.isfinite(residual)))
        n_pair += np.diff(told[pixels.events[0]]) / len(states)
    own, cross, shared = matrix[:, :n, :n].copy(), matrix[:, :n, n:].copy(), matrix[:, n:, n:].sum(axis=0)
    if not tilted:
        more = 0, 2 * plan.light.n_led
        cross, shared = np.pad(cross, ((0, 0), (0, 0), more)), np.pad(shared, (more, more))
    return own, cross, shared, n_pair  # a view would hold all of the matrix


def information_of(
    pixels: Pixels, theta: np.ndarray, rig: Rig, noise: float, own_thresholds: bool, tilted: bool
) -> tuple:
    """Give what `kernel.pixel_sums` does at the truth, of thresholds that scatter as a Gaussian."""
    terms = Terms(pixels.crossfade, noise, GAUSSIAN, 1.0)
    weigh = np.zeros(pixels.n_event)
    if rig.noise:
        *_, weigh = pixels.sums(theta, rig, own_thresholds, tilted, terms, weigh)
    return pixels.sums(theta, rig, own_thresholds, tilted, terms, weigh)


def theta_of(plan: Plan, number: np.ndarray) -> np.ndarray:
    """Give the true slopes and log reflectances (n, 2 + n_band) of some pixels."""
    n_band = plan.reflectance.shape[-1]
    normal, reflectance = plan.normal.reshape(-1, 3)[number], plan.reflectance.reshape(-1, n_band)[number]
    theta = to_theta(normal, reflectance, type(plan.light.constant_light))
    return np.stack([t.numpy() for t in theta], axis=-1).astype(float)


def pixels_of(plan: Plan, number: np.ndarray) -> Pixels:
    """Collect the light of some pixels; events and thresholds are yet to come."""
    light, schedule = plan.light, plan.schedule
    Float = type(light.constant_light)
    veil = Float(max(float(light.constant_light[0]), SMALLEST_LIGHT))
    here = replace(light, constant_light=veil).gather(owned(dr.uint32_array_t(Float), number))
    return Pixels(
        model=LambertianRing(here),
        softness=owned(Float, np.full(len(number), light.horizon)),
        events=(),
        leds=np.where(schedule.order < 0, light.n_led, schedule.order).astype(np.int64),
        threshold=np.ones((len(number), 2)),
        crossfade=float(schedule.crossfade),
        slot_us=float(schedule.slot_us),
    )


def _events(plan: Plan, pixels: Pixels, signal: np.ndarray, fixed: FixedPattern) -> tuple:
    """Simulate the events of some pixels, at exact times; see `kernel.pixel_sums`."""
    schedule, n_pixel = plan.schedule, len(fixed.state)
    veil = float(pixels.light.constant_light[0])
    found = find_crossings(signal[:, None], veil, schedule, plan.n_round, plan.pixel, fixed)
    order = np.argsort(found.pixel, kind="stable")
    slots, polarity = found.t_us[order] / schedule.slot_us, found.polarity[order]
    offset = np.append(0, np.cumsum(np.bincount(found.pixel, minlength=n_pixel)))
    n_slot = len(schedule.order)
    last = slots[np.maximum(offset[1:] - 1, 0)] if len(slots) else np.zeros(n_pixel)
    gap, inside = np.diff(slots, prepend=slots[:1]), np.ones(len(slots), bool)
    return offset, slots % n_slot, gap, polarity, inside, n_slot * plan.n_round - last
