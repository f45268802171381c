"""What all pixels share, as the events tell it: one inference, of which each effect takes its part."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.sensitivity import against
from evsdr.jit import one_thread
from evsdr.model.illumination import Illumination
from evsdr.solve.shared.infer import Inferred, corrected, infer, less_sure, own_bias, turn_deg
from evsdr.solve.shared.pixels import FEWEST_PIXELS, Pixels, choose, collect, is_far, turned
from evsdr.solve.shared.posterior import Start
from evsdr.solve.shared.rig import GROUPS, Basis, Rig, Told

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World

N_PIXEL = 300  # that tell: more tell what they share no better than the model holds
FIRST_TAU_US, FIRST_NOISE = 20.0, 0.005  # to start from, the first where darkness is as bright as usual
GUESSED_REFRACTORY_US = 200.0  # tolerance where the recording tells none
CLEAR = 4.0  # standard deviations from which there is a lag, and a dark current
# The same of noise without a clear lag; measured: noise of thresholds passes for 8, an EVK4 shows 22 in slots of 200 ms
CLEAR_NOISE = 12.0
# Scatter of thresholds from which a search may have given noise of photoreceptors all that their lag leaves, and log likelihood of an event that its
# absence must gain then; guessed. Measured (`experiments.draws`, a pixel of v2e, which has neither): 913 ends at a scatter of .005, a noise of .019 and a lag of
# 101 us for 0 and 572, 1.2 degrees, and events 449 us late that are not; without noise at 577 us, .8. 9, 932 and 8 likewise, and gain 1.5 and more. An
# EVK4's with noise, under a glossy sphere, gains .04, and its lag is then wrong
EXACT, WORTH = 0.01, 0.5
# Light without a lag has kinks, which no event passes: its likelihood is not smooth in a shift
WITH_LAG = "tau", "dark", "noise", "shift"
# When events come or references are memorised: what noise adds there, and light that moves on until then, look alike
BY_LEAD = "shift", "refractory"
# Tolerance of where a surface is that a rectangle stands for, of its width, and tolerances within which it is looked for; guessed
OF_EXTENT, REACH = 0.25, 2.0
# Tolerances of the distance from which it is known hardly better than told; guessed. Measured (`experiments.draws`): .21 where it is .6 off at
# a sigma of .12 (719), .04 to .14 in 420, 587, 600, 669, 701, 716
VAGUE = 0.2
WARNED = 3.0  # tolerances beyond which a value found is worth a warning
# Tolerances of thresholds beyond which a search ran away; guessed. Measured (`experiments.draws`): 6.6 and more in 1006; 3.2 in 9, which is as good or
# worse from elsewhere
RAN_AWAY = 5.0


@dataclass(frozen=True)
class Aim:
    """What LEDs do otherwise than told.

    Attributes
    ----------
    log_power, tilt
        See `Rig`.
    """

    log_power: np.ndarray
    tilt: np.ndarray

    def __call__(self, light: Illumination) -> Illumination:
        """Give the light that they send."""
        factors = (dr.opaque(type(light.constant_light), float(f)) for f in np.exp(self.log_power))
        irradiance = [e * factor for e, factor in zip(light.irradiance, factors)]
        dr.eval(irradiance)
        light = replace(light, irradiance=irradiance)
        return turned(light, self.tilt) if self.tilt.any() and is_far(light) else light


@dataclass(frozen=True)
class DistanceOff:
    """What the distance of near LEDs may be off by beyond what a search on a surface that stays has for sigma.

    Attributes
    ----------
    moving : float
        By how much it still moved on the surface of the fit [scene units].
    vague : float
        The tolerance within which it is told, where events hardly know it better; else 0 [scene units].
    turns_deg : float
        By which normals turn with the larger of both.
    """

    moving: float = 0.0
    vague: float = 0.0
    turns_deg: float = 0.0

    @property
    def by(self) -> float:
        return max(self.moving, self.vague)


@dataclass(frozen=True)
class SharedFound:
    """What pixels share, times in us.

    Attributes
    ----------
    inferred : Inferred
    names : tuple of str
        What was unknown, of `rig.NAMES`.
    told : Told
    told_refractory_us, slot_us : float
    untold_deg : float
        By which normals would turn if noise of photoreceptors, which the events want but do not tell from others, were in.
    no_lag : bool
        Whether photoreceptors are as quick as can be, so none of an event camera.
    moved : (n_unknown,) float64, optional
        By how much the unknowns of the median pixel moved.
    off : (n_free,) float64, optional
        What was taken off as the search's own bias, see `own_bias`: once, for all that follow of it.
    distance_off : DistanceOff
        What the distance of near LEDs may be off by.
    searched : Rig, optional
        Where the search ended, before its own bias was taken off: there the next one starts.
    """

    inferred: Inferred
    names: tuple[str, ...]
    told: Told
    told_refractory_us: float
    slot_us: float
    untold_deg: float = 0.0
    no_lag: bool = False
    moved: np.ndarray | None = None
    off: np.ndarray | None = None
    distance_off: DistanceOff = DistanceOff()
    searched: Rig | None = None

    def us(self, name: str) -> tuple[float, float]:
        """Give a time and its standard deviation [us]; of `BY_LEAD` that holds how well it is known how early noise fires events."""
        value, sigma = (getattr(of, name) for of in (self.inferred.rig, self.inferred.sigma))
        lead = self.inferred.lead if name in BY_LEAD else 0.0
        return value * self.slot_us, float(np.hypot(sigma, lead)) * self.slot_us


def find_shared(world: "World", fitted: "Fitted") -> SharedFound | None:
    """Infer what pixels share, or remember it; None if it is not asked for, or too few pixels tell."""
    if not world.terms.shared:
        return None
    return world.memo("shared", (fitted,), lambda: _infer(world, fitted))


def _infer(world: "World", fitted: "Fitted") -> SharedFound | None:
    row = choose(fitted.problem, fitted.solution, N_PIXEL)
    if len(row) < FEWEST_PIXELS:
        return None
    asked = asked_of(world, fitted, row)
    with one_thread():
        found, names, untold_deg, no_lag = _lag_or_none(asked, world)
        searched = found.rig
        found, off = _without_bias(found, names, asked, world)
    distance_off = DistanceOff()
    if asked.pixels.nearer:
        distance_off = _distance_off(found, world.found if world.moved else None, asked.told.distance)
        basis = Basis.of(names, asked.pixels.light.band)
        by = np.where(basis.owner == "distance", distance_off.by, 0)
        distance_off = replace(distance_off, turns_deg=turn_deg(found.theta, found.response @ by))
        found = less_sure(found, by, basis)
    moved = np.median(found.theta - asked.start.theta, axis=0)
    told_us, slot_us = world.recording.sensor.refractory_us, asked.pixels.slot_us
    return SharedFound(
        found, names, asked.told, told_us, slot_us, untold_deg, no_lag, moved, off, distance_off, searched
    )


def _without_bias(
    found: Inferred, names: tuple[str, ...], asked: "Asked", world: "World"
) -> tuple[Inferred, np.ndarray | None]:
    """Take off what the search is off by of its own, and give that, where it is looked for; see `own_bias`."""
    if not world.terms.thorough or world.metal is not None or found.rig.dark or found.in_vain:
        return found, None
    known = world.found.off if world.found and world.found.names == names else None
    off = own_bias(found, asked.pixels, world.recording, asked.told, names) if known is None else known
    return corrected(found, off, asked.pixels, names), off


@dataclass(frozen=True)
class Asked:
    """What is asked of some pixels: where a search starts, what is told, and what is unknown, of `rig.NAMES`."""

    pixels: Pixels
    start: Start
    rig: Rig
    told: Told
    names: tuple[str, ...]
    activity: np.ndarray | None

    def search(self, names: tuple[str, ...], start: Start | None = None) -> Inferred:
        """Search; once more with thresholds as told at first, if they ran away: what is less of a surprise stands.

        Small contrasts of weak light under small thresholds are like large ones, and whatever pixels do otherwise than their model looks
        small in them. Measured (`experiments.draws`): 1006, a cylinder whose powers are told 10 % wrong, -4.0 for the logarithms, 30.4 degrees, none
        within three sigma; now 6.2. By cost alone one of its three searches stays away.
        """
        start = start or self.start
        found = self._search(start, names)
        if "thresholds" not in names or not self._ran_away(found.rig):
            return found
        held = self._search(self._as_told(start), tuple(name for name in names if name != "thresholds"))
        other = self._search(start_from(held), names)
        return min(found, other, key=lambda one: one.surprise)

    def _search(self, start: Start, names: tuple[str, ...]) -> Inferred:
        return infer(self.pixels, start, self.rig, self.told, names, self.activity)

    def _ran_away(self, rig: Rig) -> bool:
        """Tell whether thresholds are farther from what is told than any camera's."""
        away = np.abs(rig.log_threshold - self.rig.log_threshold)
        return bool((away > RAN_AWAY * self.told.thresholds).any())

    def _as_told(self, start: Start) -> Start:
        """Start with mean thresholds that are told, and those of the pixels moved with them."""
        by, theta = self.rig.log_threshold - start.rig.log_threshold, start.theta.copy()
        theta[:, 2 + self.pixels.light.n_band :] += by[: theta.shape[1] - 2 - self.pixels.light.n_band]
        return replace(start, theta=theta, rig=replace(start.rig, log_threshold=self.rig.log_threshold))


def asked_of(world: "World", fitted: "Fitted", row: np.ndarray) -> Asked:
    told, nearer = world.terms.told, None
    if world.distance_is_unknown and "distance" in world.terms.shared:
        told = replace(told, distance=OF_EXTENT * world.surface.extent)
        nearer = world.nearer_light(fitted, row, REACH * told.distance)
        told = replace(told, distance=nearer.reach / REACH)
    pixels = collect(world.recording, fitted.problem, fitted.solution, row, world.clock_us, nearer)
    if "refractory_us" in world.recording.sensor.guessed:
        told = replace(told, refractory_us=GUESSED_REFRACTORY_US)
    names = [name for group in world.terms.shared for name in GROUPS[group] if name != "dark"]
    if nearer is None:
        names = [name for name in names if name != "distance"]
    if not is_far(pixels.light) or world.metal is not None:
        names = [name for name in names if name != "directions"]
    if "tau" not in names:
        names = [name for name in names if name not in WITH_LAG]
    rig, activity = _told(world, pixels), world.background[0] if world.background else None
    start = _start(world, fitted, rig, row, pixels.dimness)
    return Asked(pixels, start, rig, told, tuple(names), activity)


def _lag_or_none(asked: Asked, world: "World") -> tuple[Inferred, tuple[str, ...], float, bool]:
    """Search with a lag, and without one where there is none; gives also what was unknown, and `SharedFound`'s untold_deg and no_lag."""
    names, without = asked.names, tuple(name for name in asked.names if name not in WITH_LAG)
    if "tau" not in names:
        found = asked.search(names)
        return found, names, 0.0, found.no_lag
    before = world.found or last_found(world.decisions)
    lagless = asked.search(without) if before and before.no_lag else None
    if lagless and lagless.wanted["tau"] < CLEAR:
        return lagless, without, 0.0, True
    if before and "tau" in before.names and "noise" not in before.names:
        names = tuple(name for name in names if name != "noise")
    found, names = _with_dark(asked, names, world)
    if found.scatter < EXACT and found.rig.noise > CLEAR * found.sigma.noise:
        quiet, without_noise = _with_dark(asked, tuple(name for name in names if name != "noise"), world)
        if quiet.surprise < found.surprise - WORTH * asked.pixels.n_event:
            found, names = quiet, without_noise
    if _lags(found, world):
        return found, names, 0.0, found.no_lag
    lagless = lagless or asked.search(without)
    # Thresholds that scatter pass for noise of up to 14, but then of photoreceptors that lead (experiments.sigma, ideal)
    noisy = lagless.wanted["noise"] > CLEAR_NOISE and lagless.wanted["tau"] > 0
    untold_deg = found.turn_deg["lag"] if noisy and not found.no_lag else 0.0
    return lagless, without, untold_deg, found.no_lag


def _with_dark(asked: Asked, names: tuple[str, ...], world: "World") -> tuple[Inferred, tuple[str, ...]]:
    """Search, and once more with a dark current where events want one; gives also what was unknown."""
    found = asked.search(names)
    if "dark" in names or found.in_vain or found.wanted["dark"] <= CLEAR or not _lags(found, world):
        return found, names
    names = (*names, "dark")
    return asked.search(names, start_from(found)), names


def _distance_off(found: Inferred, last: SharedFound | None, tolerance: float) -> DistanceOff:
    """Give by how much the distance moved once light was traced on the surface of the fit, and whether events tell it at all.

    That surface follows the distance that was found before, so a search on it stays near that one, and its sigma is of a surface that stays:
    it may have to move as much again. Measured on spheres (`experiments.draws`, 587, and as --but has it), normals within 1 2 3 sigma without and
    with this: 4 15 30 and 43 100 100 %; 2 6 14 and 10 63 100; 0 2 6 and 3 13 41; on a cylinder (411) 10 26 36 and 60 99 99.
    """
    moving = abs(found.rig.distance - last.inferred.rig.distance) if last else 0.0
    return DistanceOff(moving, tolerance if found.sigma.distance > VAGUE * tolerance else 0.0)


def _lags(found: Inferred, world: "World") -> bool:
    """Tell whether there is a lag, or noise as light shows it that is too slow for a lag, and whether they count."""
    rig, sigma = found.rig, found.sigma
    shows = rig.tau > CLEAR * sigma.tau or rig.noise > CLEAR_NOISE * sigma.noise
    return shows and not found.no_lag and found.turn_deg["lag"] > world.terms.limit_deg


def start_from(found: Inferred) -> Start:
    """Start again with what was found."""
    return Start(found.theta, found.rig, found.spread, found.scatter, found.departs)


def _told(world: "World", pixels: Pixels) -> Rig:
    """Give what the files tell."""
    n_led, refractory_us = pixels.light.n_led, world.recording.sensor.refractory_us
    times = 0.0, 0.0, 0.0, 0.0, refractory_us / pixels.slot_us, 0.0, 0.0
    return Rig(np.zeros(n_led), *times, np.zeros(2), np.zeros((n_led, 2)))


def _start(world: "World", fitted: "Fitted", told: Rig, row: np.ndarray, dimness: float) -> Start:
    """Start from a fit, and from what an earlier one made pixels share."""
    solution = fitted.solution
    prior = solution.threshold_prior or (0.0, 0.0, 1.0, 1.0)
    theta, spread = solution.all_theta[row].astype(float), np.array(prior[2:])
    if world.found:
        rig = world.found.searched or world.found.inferred.rig
        start = replace(start_from(world.found.inferred), theta=theta, rig=rig, spread=spread)
    else:
        rig = replace(told, log_threshold=np.array(prior[:2]))
        start = Start(theta, rig, spread, solution.noise)
    if "lag" in world.terms.shared and start.rig.tau == 0:
        tau = dimness * FIRST_TAU_US / world.recording.schedule.slot_us
        start = replace(start, rig=replace(start.rig, tau=tau, noise=FIRST_NOISE))
    return start


def last_found(decisions: dict[str, Decision]) -> SharedFound | None:
    """Give what was found last of what pixels share."""
    return next((d.answer for d in reversed(decisions.values()) if isinstance(d.answer, SharedFound)), None)


def in_doubt(decisions: dict[str, Decision], name: str) -> bool:
    """Tell whether something of `rig.NAMES` that was found may as well be as told."""
    found = last_found(decisions)
    return found is not None and name in found.inferred.doubted


class SharedEffect:
    """One group of what pixels share: what all of `effects.leds`, `lag`, `clock`, `refractory` and `thresholds` do alike.

    Attributes
    ----------
    group : str
        Of `rig.GROUPS`.
    untold : str
        Why it was not asked for.
    """

    name: str
    group: str
    untold = "too few pixels tell it"
    option, when = "shared", "alone"

    def decide(self, asked, world: "World", fitted: "Fitted") -> Decision | None:
        """Take what the events tell, if it turns normals by more than the limit."""
        if world.terms.solver == "adam":
            return self.as_told("the solver adam infers nothing but maps")
        if self.group not in world.terms.shared:
            return self.as_told("asked for by --shared")
        found = find_shared(world, fitted)
        if found is None:
            return self.as_told("too few pixels tell it")
        if not set(GROUPS[self.group]) & set(found.names):
            return replace(self.as_told(self.untold), doubt=self.doubt(found, world.terms.limit_deg))
        error, limit = found.inferred.turn_deg[self.group], world.terms.limit_deg
        modelled = error > limit and self.is_clear(found)
        doubt = "" if modelled or error <= limit else " too near to what is told to be told from it;"
        why = f"{'as found' if modelled else 'as told'}: {self.say(found)};{doubt} {against(error, error > limit, limit)}"
        return Decision(self.name, modelled, why, error, self.numbers(found), found, self.warning(found))

    def warning(self, found: SharedFound) -> str:
        """Give what its user should look into if it is modelled; nothing by default."""
        return ""

    def doubt(self, found: SharedFound, limit_deg: float) -> str:
        """Give what its user should look into though the events do not tell it; nothing by default."""
        return ""

    def is_clear(self, found: SharedFound) -> bool:
        """Tell whether what was found differs from what is told by more than noise and a model that is not quite right."""
        return True

    def as_told(self, why: str) -> Decision:
        """Decide on nothing."""
        return Decision(self.name, False, f"as told: {why}")

    def say(self, found: SharedFound) -> str:
        """Give what was found in words."""
        raise NotImplementedError

    def numbers(self, found: SharedFound) -> dict:
        """Give what was found in numbers, for the summary."""
        raise NotImplementedError


def plus_minus(pair: tuple[float, float], unit: str = "us") -> str:
    """Write a value with its standard deviation."""
    return f"{pair[0]:.3g} +- {pair[1]:.2g} {unit}"
