"""What speaks against what files tell of a set-up: residuals of events, of single LEDs, and normals that no surface has."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from evsdr.effects.crossfade import may_switch
from evsdr.effects.orientation import Bends, bends_of, turn_between
from evsdr.light.camera import camera_geometry
from evsdr.light.ground_truth import object_depth, object_normals
from evsdr.metrics import angular_error_deg
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing, signals_of
from evsdr.solve.noise import IGNORED
from evsdr.solve.pair_data import PairData
from evsdr.solve.solution import Solution

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World

N_SAMPLE = 600  # pixels that show how well each LED is explained
# Measured on all scenes of the repository, an EVK4's events of which leave 0.04 to 0.07, LEDs at most 1.39
NOISY = 0.12  # scatter of most pixels' residuals from which the set-up is in doubt
KNOWN_NOISY = (
    0.075  # the same of thresholds that are taken as told; told half or double they leave 0.09 and more
)
# The same from which LEDs may fade otherwise than told; measured, a sphere under slots of 20 ms: a crossfade of 0.8 told as 1 leaves 0.098
FADING = 0.08
SUSPICIOUS = 1.4  # residual of an LED, relative to that of most, from which its light is in doubt
N_WORST, N_MATE = 6, 4  # LEDs in doubt at most: by their own residuals, and as of the band of the worst
# Measured: surfaces have a share of curl of 0.02 to 0.09, a ring turned by one LED of 24 0.09 to 0.2; but no turn lessens that
# of noise, be it 0.09 or, on planes, 0.5
CURL, LESS_CURL, LEAST_PLACES = 0.07, 0.5, 50
# Median angle to a known shape, and what part of it some turn must leave; guessed
SHAPE_DEG, LESS_DEG = 8.0, 0.5
VARIED_DEG = 10.0  # scatter of the normals of a shape that tells turns apart; guessed
# Reflectance that no surface has, and the percentage of the pixels that must have it; guessed
BRIGHT, BRIGHT_SHARE = 2.0, 10.0


@dataclass(frozen=True)
class Doubts:
    """What speaks against what is told.

    Attributes
    ----------
    noise : float
        Scatter of most pixels' residuals.
    suspects : list of int
        LEDs whose events are explained worse than those of others.
    bends : Bends
        Of the fitted slopes.
    shape_deg : float, optional
        Median angle between fitted normals and those of a known shape that is not flat.
    curl, shape : bool
        Whether these speak.
    reflectance : float
        What the brightest tenth of the pixels exceed.
    dark : bool
        Whether no constant light is told.
    known : bool
        Whether thresholds are taken as told.
    switches : bool
        Whether times of events are those of LEDs that switch, which are told to fade.
    """

    noise: float
    suspects: list
    bends: Bends
    shape_deg: float | None
    curl: bool
    shape: bool
    reflectance: float
    dark: bool = False
    known: bool = False
    switches: bool = False

    @property
    def events(self) -> bool:
        """Whether events are explained badly."""
        return self.noise > NOISY or bool(self.suspects)

    @property
    def thresholds(self) -> bool:
        """Whether events are explained worse than thresholds that are as told do."""
        return self.noise > (KNOWN_NOISY if self.known else NOISY)

    @property
    def fading(self) -> bool:
        """Whether LEDs may fade otherwise than told."""
        return self.noise > FADING or self.switches

    @property
    def bright(self) -> bool:
        """Whether reflectances are above what any surface has, though events are explained."""
        return self.reflectance > BRIGHT and self.noise < NOISY

    @property
    def any(self) -> bool:
        """Whether anything speaks."""
        return any((self.events, self.thresholds, self.fading, self.curl, self.shape, self.dark, self.bright))


def doubts_of(world: "World", fitted: "Fitted") -> Doubts:
    """Look at a fit of pixels that are each alone."""
    problem, solution, maps = fitted.problem, fitted.solution, fitted.maps
    residual = led_residuals(problem.pairs, problem.illumination, solution)
    camera, _ = camera_geometry(world.ring.sensor)
    bends = bends_of(maps.normal.astype(float), maps.mask, camera)
    share = bends.curl()
    curl = bends.n >= LEAST_PLACES and share > CURL and bends.least_curl() < LESS_CURL * share
    angle, least = shape_angles(world, fitted)
    dark = world.ring.constant_light == 0
    brightest = (maps.reflectance - 3 * maps.reflectance_sigma).max(axis=-1)[maps.mask & (not dark)]
    return Doubts(
        noise=solution.noise,
        suspects=suspects(residual, problem.illumination.band),
        bends=bends,
        shape_deg=angle,
        curl=curl,
        shape=angle is not None and angle > SHAPE_DEG and least < LESS_DEG * angle,
        reflectance=float(np.percentile(brightest, 100 - BRIGHT_SHARE)) if len(brightest) else 0.0,
        dark=dark,
        known=not world.thresholds,
        switches=may_switch(world.recording),
    )


def suspects(residual: np.ndarray, band: list[int]) -> list[int]:
    """List the LEDs that may be at fault, if any is, by their residuals (n_led).

    A dead LED leaves no events to contradict it, but the others of its band are then explained badly.
    """
    if residual.max() <= SUSPICIOUS:
        return []
    worst = np.argsort(-residual)
    mates = [j for j in worst[N_WORST:] if band[j] == band[worst[0]]]
    return sorted(int(j) for j in (*worst[:N_WORST], *mates[:N_MATE]))


def shape_angles(world: "World", fitted: "Fitted") -> tuple[float | None, float]:
    """Give the median angle between fitted normals and those of a known shape, and the least that a turn of image or
    ring leaves [deg]; None where no shape is known, or it is flat."""
    shape = known_shape(world)
    if shape is None:
        return None, 0.0
    known = fitted.maps.mask & (object_depth(world.ring) > 0)
    if np.count_nonzero(known) < LEAST_PLACES:
        return None, 0.0
    told = fitted.maps.normal.astype(float)
    angle = float(np.median(angular_error_deg(told[known], shape[known])))
    moves = [lambda a: a, np.fliplr, np.flipud, lambda a: np.rot90(a, 2)]
    if known.shape[0] == known.shape[1]:
        moves += [lambda a: np.swapaxes(a, 0, 1), np.rot90, lambda a: np.rot90(a, 3)]
    least = angle
    for move in moves:
        both = known & move(known)
        if np.count_nonzero(both) < LEAST_PLACES:
            continue
        turned, there = move(told)[both], shape[both]
        turn, _ = turn_between(turned[:, :2], there[:, :2])
        turned = np.column_stack([turned[:, :2] @ turn.T, turned[:, 2]])
        least = min(least, float(np.median(angular_error_deg(turned, there))))
    return angle, least


def known_shape(world: "World") -> np.ndarray | None:
    """Give the normals (height, width, 3) of a shape that is known and not flat."""
    if not world.ring.shape_is_known:
        return None
    normal, seen = object_normals(world.ring), object_depth(world.ring) > 0
    varied = np.degrees(np.sqrt(np.var(normal[seen], axis=0).sum())) if seen.any() else 0.0
    return normal if varied > VARIED_DEG else None


def led_residuals(pairs: PairData, light: Illumination, solution: Solution) -> np.ndarray:
    """Give the median of |u| of the events while each LED fades in or out, relative to that of most LEDs.

    Parameters
    ----------
    pairs : PairData
        Event pairs.
    light : Illumination
        What the LEDs send.
    solution : Solution
        The maps that should explain them.

    Returns
    -------
    (n_led,) float
        0 for an LED that has no events.
    """
    first, count = pairs.first.numpy().astype(np.int64), pairs.counts
    explained = (solution.noise_factor < IGNORED) & (count > solution.theta.shape[1])
    some = np.flatnonzero(explained)
    some = some[:: max(1, len(some) // N_SAMPLE)]
    pixel = np.repeat(some, count[some])
    if not len(some):
        return np.zeros(light.n_led)
    k = np.concatenate([np.arange(first[i], first[i] + count[i]) for i in some])
    signal = signals_of(LambertianRing(light), solution.theta)
    start, coded = pairs.phases.numpy().reshape(-1, 2)[k].T
    end, polarity = np.abs(coded) - 1, np.sign(coded)
    leds = pairs.slot_leds.numpy()
    now, following = leds & 0xFFFF, leds >> 16
    veil = float(light.constant_light[0])

    def intensity(phase):
        slot = phase.astype(int)
        fade = phase - slot
        return (1 - fade) * signal[now[slot], pixel] + fade * signal[following[slot], pixel] + veil

    gains = np.ones((len(signal[0]), 2)) if solution.threshold_gain is None else solution.threshold_gain
    threshold = np.where(
        polarity > 0,
        (pairs.threshold_on.numpy() * gains[:, 0])[pixel],
        (pairs.threshold_off.numpy() * gains[:, 1])[pixel],
    )
    u = np.abs(polarity * np.log(intensity(end) / intensity(start)) / threshold - 1)
    slot = end.astype(int)
    out = np.zeros(light.n_led)
    for j in range(light.n_led):
        of_led = (now[slot] == j) | (following[slot] == j)
        out[j] = np.median(u[of_led]) if of_led.any() else 0
    return out / max(np.median(out[out > 0]), 1e-9) if out.any() else out
