"""Some pixels with their events and their light: what the inference of shared unknowns works on."""

from dataclasses import dataclass, replace
from functools import cached_property

import drjit as dr
import numpy as np
from scipy import ndimage

from evsdr.events.lead import TABLE
from evsdr.events.pair_kernel import sort_by_pixel
from evsdr.events.phase import position
from evsdr.events.photoreceptor import SHORTEST
from evsdr.frozen import recorded
from evsdr.model.arrays import columns, owned
from evsdr.model.illumination import Illumination
from evsdr.records import Recording
from evsdr.solve.levenberg import horizon
from evsdr.solve.pair_data import Table, room_for
from evsdr.solve.problem import Problem
from evsdr.solve.shared.kernel import Terms, pixel_sums
from evsdr.solve.shared.rig import TIMES, Rig, across
from evsdr.solve.solution import Solution
from evsdr.solve.unknowns import to_normal

# Of a pixel that tells, and where fewer than so many do; guessed. Measured (`experiments.draws`, 1133 1167 1176, which had nothing inferred), normals within 1 2 3 sigma
# without the second and with it: 29 64 89 -> 66 99 100, 36 66 84 -> 38 88 99, 11 94 100 -> 100 100 100; 9.96 8.88 6.27 -> 6.30 11.3 2.91 degrees
FEWEST_EVENTS, FEWEST_PIXELS = (20, 8), 20
# Events, at most, of pixels that tell, but of so many pixels at least; guessed. Measured (`experiments.draws`, 2 3 9 1158, of 90,000 to 200,000 events): 41
# 13 181 169 s -> 25 12 73 65, .45 .35 12.2 2.85 degrees -> .48 .40 11.0 2.86
MOST_EVENTS, FEWEST = 60_000, 60
FEWEST_LIT = 5  # of one that is part of the object: of leaks a second has 0.1; guessed
# Windows that must lie on the object around a pixel that tells, the first that leaves enough of them. Measured on a sphere near LEDs
# whose rectangle is larger than it: with 3 pixels its distance is found as 0.77 for 0.70, with 5 as 0.73, with 7 as 0.72; with a mask
# of the sphere's whole pixels 0.71, 0.69, 0.67
RIMS = 5, 3
CLEAR = 1.5  # noise of such a pixel, relative to most, at most: in others more may be wrong
FEW = 1e-3  # of the events, that may come sooner: noise
# C_w that times of photoreceptors are made for, and what a C_w of 0 counts as
USUAL_DARK, LEAST_DARK = 0.05, 1e-9
DARKEST = 1e-30  # irradiance and light that are not 0: their roots and logarithms are within float32
# Photoreceptors that are quicker (where darkness is as bright as usual) are none: event cameras' take longer, and thresholds' scatter passes for
# the noise of quick ones. Guessed; measured with 1 us and a scatter of 20 % (`experiments.draws` 835 and 843 as experiments/shared/README.md has
# them): noise .048 and .049 for .0097, thresholds 30 % high, R 1.44 and 2.28 times the true ones; with 10 and 20 us 1.03 and 1.13
QUICKEST_US = 10.0
STEP_OF_REACH = 1e-2  # for derivatives by distance; guessed: rounding leaves 1e-5 of them
STEPS = {"tau": 1e-5, "dark": 1e-4, "noise": 1e-5, "pole": 1e-2}  # for derivatives


@dataclass(frozen=True)
class Nearer:
    """The light of some pixels if the surface is nearer to the camera.

    Attributes
    ----------
    reach : float
        How far it may be [scene units].
    light : (3,) Illumination
        At -reach, 0 and reach.
    """

    reach: float
    light: tuple

    @property
    def is_lit(self) -> bool:
        """Whether every LED that shines on a pixel does so wherever the surface is."""
        lit = [
            np.array([np.broadcast_to(e.numpy() > 0, self.n_pixel) for e in of.irradiance])
            for of in self.light
        ]
        return bool(np.all(lit[1] <= (lit[0] & lit[2])))

    @property
    def n_pixel(self) -> int:
        return max(dr.width(e) for e in self.light[1].irradiance)

    def __call__(self, light: Illumination, by: float) -> Illumination:
        """Give light as if the surface were nearer.

        The direction divided by the root of the irradiance is in proportion to the way to a point LED: it follows a parabola
        between the three, of points exactly.
        """
        x, Float = by / self.reach, type(light.constant_light)
        weight = [dr.opaque(Float, w) for w in (0.5 * x * (x - 1), 1 - x * x, 0.5 * x * (x + 1))]
        return _nearer(light, list(self.light), weight)


@recorded
def _nearer(light: Illumination, nodes: list, weight: list) -> Illumination:
    direction, irradiance = [], []
    for j, (here, e) in enumerate(zip(light.direction, light.irradiance)):
        length = [dr.rsqrt(dr.maximum(node.irradiance[j], DARKEST)) for node in nodes]
        ways = [[n * node.direction[j][k] for n, node in zip(length, nodes)] for k in range(3)]
        way = [
            sum(w * a for w, a in zip(weight, of)) + length[1] * here[k] - of[1] for k, of in enumerate(ways)
        ]
        square = sum(a * a for a in way)
        direction.append(type(here)(*(a * dr.rsqrt(square) for a in way)))
        irradiance.append(e * dr.square(length[1]) / square)
    return replace(light, direction=direction, irradiance=irradiance)


@dataclass(frozen=True)
class Pixels:
    """Some pixels.

    Attributes
    ----------
    model : LambertianRing or GlossyRing
        Forward model of these.
    softness : Float, (n_pixel)
        Of their horizon.
    events, leds
        See `kernel.pixel_sums`.
    threshold : (n_pixel, 2) float64
        C_on and C_off as told.
    crossfade, slot_us : float
        Of the schedule.
    clock : float
        Step of the clock [slots].
    nearer : Nearer, optional
        Where LEDs are near to a surface whose distance is not known.
    """

    model: object
    softness: object
    events: tuple
    leds: np.ndarray
    threshold: np.ndarray
    crossfade: float
    slot_us: float
    clock: float = 0.0
    nearer: Nearer | None = None

    @property
    def light(self) -> Illumination:
        return self.model.illumination

    @property
    def n_event(self) -> int:
        return len(self.events[1])

    @property
    def dimness(self) -> float:
        """Give the light in the dark, relative to a usual one, 1 at most: a photoreceptor lags as much more there."""
        return min(1.0, max(float(self.light.constant_light[0]), LEAST_DARK) / USUAL_DARK)

    @property
    def quickest(self) -> float:
        """Give the least time constant of photoreceptors at I = 1 [slots]."""
        return QUICKEST_US * self.dimness / self.slot_us

    @cached_property
    def shortest(self) -> float:
        """Give the shortest time between events of a pixel [slots], but for a few: no refractory period is longer."""
        offset, _, gap = self.events[:3]
        follows = np.ones(len(gap), bool)
        follows[offset[:-1][offset[:-1] < len(gap)]] = False
        return float(np.quantile(gap[follows], FEW)) if follows.any() else np.inf

    def without(self, left: np.ndarray) -> "Pixels":
        """Leave out what some events (n_event,) bool end; the next ones still start there."""
        offset, at, gap, polarity, inside, ending = self.events
        return replace(self, events=(offset, at, gap, polarity, inside & ~left, ending))

    def signals(self, theta: np.ndarray, rig: Rig) -> np.ndarray:
        """Give the signals (n_pixel, 4 or 5, n_led) of maps (n_pixel, 2 + n_band) under a rig, see `kernel.pixel_sums`."""
        light = turned(self.light, rig.tilt) if rig.tilt.any() else self.light
        if self.nearer is None:
            rows = self._signals(light, theta)
        else:
            step = STEP_OF_REACH * self.nearer.reach
            rows, after, before = (
                self._signals(self.nearer(light, rig.distance + by), theta) for by in (0, step, -step)
            )
            rows = np.concatenate([rows, (after[:1] - before[:1]) / (2 * step)])
        return np.ascontiguousarray(np.transpose(rows, (2, 0, 1)) * np.exp(rig.log_power))

    def _signals(self, light: Illumination, theta: np.ndarray) -> np.ndarray:
        """Give the first four of them (4, n_led, n_pixel) under some light."""
        model = replace(self.model, illumination=light)
        Float = type(light.constant_light)
        room = room_for(Float, len(theta), light.n_led)
        values = _signals(model, columns(Float, theta), self.softness, room).numpy()
        return values.reshape(len(theta), -1, 4)[:, :-1].transpose(2, 1, 0).astype(float)

    def speed(self, theta: np.ndarray, rig: Rig) -> float:
        """Give by how much log I changes in a slot where it changes, as its events see it on average; never 0."""
        dark = np.zeros((len(theta), 1))
        light = np.concatenate([self.signals(theta, rig)[:, 0], dark], axis=1)[:, self.leds]
        log_light = np.log(np.maximum(light + float(self.light.constant_light[0]), DARKEST))
        change = np.abs(log_light - np.roll(log_light, 1, axis=1))
        return max(float(np.sum(change**2) / max(np.sum(change), 1e-6)), 1e-6)

    def tilts(self, theta: np.ndarray, rig: Rig) -> np.ndarray:
        """Give the derivatives (n_pixel, n_led, 2) of log A_xj by the direction of far LEDs.

        That of the logarithm of `lambert.soft_max0` is 1 / sqrt(x^2 + softness^2).
        """
        normal, softness = to_normal(theta), self.softness.numpy()
        out = np.zeros((len(theta), self.light.n_led, 2))
        for j, (told, now) in enumerate(zip(self.light.direction, turned(self.light, rig.tilt).direction)):
            here, axes = vector_of(now), across(vector_of(told))
            longer = np.sqrt(
                1 + rig.tilt[j] @ rig.tilt[j]
            )  # told + tilt . axes, before it is made a unit vector
            moved = (axes - np.outer(axes @ here, here)) / longer
            out[:, j] = (normal @ moved.T) / np.hypot(normal @ here, softness)[:, None]
        return out

    def sums(
        self,
        theta: np.ndarray,
        rig: Rig,
        own_thresholds: bool,
        tilted: bool,
        terms: Terms,
        weigh: np.ndarray,
        some: np.ndarray | None = None,
        stirred: tuple[str, ...] = tuple(STEPS),
        kind: np.ndarray | None = None,
        departure: np.ndarray | None = None,
    ) -> tuple:
        """Sum cost, gradient and information of each pixel, see `kernel.pixel_sums`.

        Parameters
        ----------
        theta : (n_pixel, n) float
            Maps, and where thresholds are unknown the logarithms of their factors.
        rig : Rig
        own_thresholds, tilted : bool
            Whether thresholds of each pixel, and directions of LEDs, are among the unknowns.
        terms, weigh, some, kind
            See `kernel.pixel_sums`.
        stirred : tuple of str
            Of `STEPS`: those by which derivatives are wanted.
        departure : (n_pixel, n_led) float
            By how much pixels see LEDs brighter than the model has them, of the logarithm; 0 by default.
        """
        departure = np.zeros((len(theta), self.light.n_led)) if departure is None else departure
        light, n_map = self.light, 2 + self.light.n_band
        gains, maps = theta[:, n_map:] if own_thresholds else rig.log_threshold, theta[:, :n_map]
        return pixel_sums(
            self.events,
            self.leds,
            np.array(light.band),
            float(light.constant_light[0]),
            self.signals(maps, rig) * np.exp(departure)[:, None],
            self.tilts(maps, rig) if tilted else np.zeros((len(theta), light.n_led, 0)),
            self.threshold * np.exp(gains),
            own_thresholds,
            stirred_values(rig, stirred, SHORTEST * self.dimness),
            terms,
            TABLE,
            weigh,
            some,
            kind,
        )


def stirred_values(rig: Rig, stirred: tuple[str, ...], shortest: float = SHORTEST) -> np.ndarray:
    """Give the `values` of `kernel.pixel_sums`, with derivatives by some of `STEPS`; tau is `shortest` at least."""
    values = np.tile([getattr(rig, name) for name in TIMES], (1 + len(STEPS), 1))
    values[:, 0] = max(rig.tau, shortest)
    for row, (name, step) in enumerate(STEPS.items(), 1):
        step *= min(values[0, 0] / 5e-3, 1.0) if name == "tau" else 1.0
        values[row, TIMES.index(name)] += step if name in stirred else 0.0
    return values


@recorded
def _signals(model, theta: list, softness, room):
    """Lay signals, their slope derivatives and the part that scales with the reflectance out, see `Table.of`."""
    signal, by_p, by_q, *diffuse = model(theta[0], theta[1], [dr.exp(t) for t in theta[2:]], softness)
    rows = zip(signal, by_p, by_q, diffuse[0] if diffuse else signal)
    return Table.of([list(row) for row in rows], dr.width(theta[0]), room).values


def is_far(light: Illumination) -> bool:
    """Tell whether every LED has one direction for all pixels."""
    return all(dr.width(direction) == 1 for direction in light.direction)


def turned(light: Illumination, tilt: np.ndarray) -> Illumination:
    """Turn the directions of far LEDs by angles (n_led, 2) along `rig.across` [rad]."""
    out = []
    for direction, angles in zip(light.direction, tilt):
        here = vector_of(direction)
        moved = here + angles @ across(here)
        kind = type(direction.x)
        out.append(type(direction)(*(dr.opaque(kind, float(v)) for v in moved / np.linalg.norm(moved))))
    return replace(light, direction=out)


def vector_of(direction) -> np.ndarray:
    """Give the direction of a far LED (3,)."""
    return np.array([float(part[0]) for part in direction])


def choose(problem: Problem, solution: Solution, most: int) -> np.ndarray:
    """Choose pixels that tell: with events enough that agree with the model, and not near the rim of the object.

    That is where events end, as a mask may hold what is around it, too; silent spots within it are no rim. Fewer than `most` do
    where each has many events.
    """
    mask, counts = problem.grid.mask, problem.pairs.counts
    lit = np.zeros(mask.shape, bool)
    lit[mask] = counts >= FEWEST_LIT
    lit = ndimage.binary_fill_holes(lit) & mask
    for fewest in FEWEST_EVENTS:
        clear = (counts >= fewest) & (solution.noise_factor < CLEAR)
        for width in RIMS:
            inner = ndimage.binary_erosion(lit, np.ones((width, width)))
            row = np.flatnonzero(clear & inner.ravel()[problem.pixel])
            if len(row) >= most:
                break
        if len(row) >= FEWEST_PIXELS:
            break
    row = np.random.default_rng(0).permutation(row)[:most]
    enough = np.cumsum(counts[row]) <= MOST_EVENTS
    enough[:FEWEST] = True
    return np.sort(row[enough])


def collect(
    recording: Recording,
    problem: Problem,
    solution: Solution,
    row: np.ndarray,
    clock_us: float = 0.0,
    nearer: Nearer | None = None,
) -> Pixels:
    """Collect some rows of a problem, with the events of their pixels, and what light they have if the surface is nearer."""
    schedule, pairs, light = recording.schedule, problem.pairs, problem.illumination
    Float, UInt32 = type(light.constant_light), type(pairs.first)
    soft = dr.opaque(Float, light.horizon, problem.n_pixel)
    if solution.curved:
        soft = horizon(columns(Float, solution.theta), problem.grid.links, soft)
    thresholds = [value.numpy()[row] for value in (pairs.threshold_on, pairs.threshold_off)]
    return Pixels(
        model=problem.model_at(owned(UInt32, row)),
        softness=owned(Float, soft.numpy()[row]),
        events=events_of(recording, problem.pixel[row]),
        leds=np.where(schedule.order < 0, light.n_led, schedule.order).astype(np.int64),
        threshold=np.stack(thresholds, axis=-1).astype(float),
        crossfade=float(schedule.crossfade),
        slot_us=float(schedule.slot_us),
        clock=clock_us / schedule.slot_us,
        nearer=nearer,
    )


def events_of(recording: Recording, number: np.ndarray) -> tuple:
    """Give the `events` of `kernel.pixel_sums` of pixels y * width + x, growing, each with an event at least."""
    chosen = np.zeros((recording.sensor.height, recording.sensor.width), bool)
    chosen.ravel()[number] = True
    offset, p, t = sort_by_pixel(*(getattr(recording.events, name) for name in "xypt"), chosen)
    first = np.append(offset[number], offset[-1])
    schedule, rounds = recording.schedule, recording.round_start_us
    at, inside = position(t, schedule, rounds)
    end = rounds[-1] if len(rounds) > 1 else recording.events.t.max()
    gap, rest = np.diff(t, prepend=t[:1]), np.maximum(end - t[first[1:] - 1], 0)
    inside &= np.append(False, inside[:-1])
    polarity = (2 * p - 1).astype(np.int8)
    return first, at, gap / schedule.slot_us, polarity, inside, rest / schedule.slot_us
