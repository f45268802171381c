"""Gross errors of a set-up: tried where something speaks against what is told, and believed if they explain it.

A hypothesis is worth the log likelihood that it gains over what is told: of the events of some pixels that are fitted
anew under it, and of their normals, by a known shape and by the curl of the slopes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from evsdr.effects.doubts import LEAST_PLACES, NOISY, VARIED_DEG, Doubts, doubts_of, known_shape
from evsdr.effects.effect import Decision
from evsdr.effects.hypotheses import (
    Hypothesis,
    clocks,
    faults,
    half_turn,
    images,
    opposite,
    orders,
    polarities,
    thresholds,
    too_bright,
    veils,
)
from evsdr.effects.orientation import bends_of, turn_between
from evsdr.effects.trials import Trial, chosen, try_all
from evsdr.light.camera import camera_geometry
from evsdr.metrics import angular_error_deg
from evsdr.records import Maps
from evsdr.solve.noise import MEDIAN_TO_SIGMA

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World

FEWEST = 20  # pixels that can convict
# Pixels that tell shadows, which few have, and the cost of an event pair that tells them; measured: 0.002 to 0.1
N_SHADED, SHADED = 400, 1e-3
# The same, of a surface that is hollow against one that is raised; measured: reliefs 0.014 to 0.036, spheres and bumpy meshes 3
HOLLOW = 0.005
LITTLE = 0.1  # of that, what the better of both may lose against no shadows at all; guessed: 0.005 beside a pole's shadows
# Hypotheses that are tried once more, each by itself, and at most if they explain as much
N_RUN_OFF, N_TIED = 3, 6
# Of log likelihood of an event pair: what convicts, measured (right hypotheses gain 0.4 and more, wrong ones that explain
# the events 0.12 at most), and what means nothing
GAIN, SLIP = 0.25, 0.02
LOST = 0.15  # share of the events that stay unexplained; measured: 0.03 under right hypotheses, 0.27 under hard switches
SHAPE_DEG = 5.0  # by which normals of a known shape may be off; guessed
# Of log likelihood of a pixel's normal, and the part of the contradiction that may remain; guessed
NORMAL_GAIN, LESS = 1.0, 0.5
# Share of curl that noise makes, and what bends count beside normals of a known shape; guessed
CURL_FLOOR, CURL_WEIGHT = 0.03, 2.0
# Factor from which thresholds that shall be known are told wrong, guessed, and how many times their scatter over the pixels
# its logarithm must be; measured: 2.8 and more where they are told half or double, 1.5 under hard switches
WRONG_THRESHOLD, CONSISTENT = 1.5, 2.0
OPEN = (
    "no shadow tells a raised surface from a hollow one, which half a turn of image or ring would make of it"
)
DOUBT = (
    "the events lack the shadows of the fitted surface; image or ring may be turned by 180 degrees, so that raised and hollow "
    "change places: look whether the surface is raised where it should be, and turn CD/events or schedule/order if it is not."
)
RIGID = 0.9  # how well normals under a hypothesis must be those as told, turned, to tell its curl
SURE = 0.5  # pixels: nearer hits of a surface on itself may come of its noise
TIE = 0.5  # of log likelihood of a pixel: hypotheses as near to the best explain as much


@dataclass(frozen=True)
class Score:
    """What speaks for a hypothesis, in log likelihood over what is told.

    Attributes
    ----------
    trial : Trial
    events : float
        Of an event pair.
    shape, curl : float
        Of a pixel's normal, by a known shape, and by the curl of the slopes.
    shape_deg : float
        Median angle to the known shape [deg]; 0 where none is known.
    curl_share : float
        See `Bends.curl`; that as told where it is not known.
    """

    trial: Trial
    events: float = 0.0
    shape: float = 0.0
    curl: float = 0.0
    shape_deg: float = 0.0
    curl_share: float = 0.0

    @property
    def total(self) -> float:
        """Give the log likelihood of a pixel."""
        clear = np.sign(self.events) * max(abs(self.events) - SLIP, 0)
        pairs = len(self.trial.residual) / len(self.trial.place)
        return float(clear * pairs + self.shape + self.curl)


@dataclass(frozen=True)
class Finding:
    """The hypothesis that explains what contradicts the files.

    Attributes
    ----------
    hypothesis : Hypothesis
    evidence : str
    others : tuple of str
        What would explain as much.
    """

    hypothesis: Hypothesis
    evidence: str
    others: tuple[str, ...] = ()

    def __str__(self) -> str:
        other = f", or {self.others[0]}" if self.others else ""
        return f"{self.hypothesis.what}{other}: {self.evidence}"


class Judge:
    """Scores hypotheses on one fit."""

    def __init__(self, world: "World", fitted: "Fitted", doubts: Doubts, told: Trial):
        self.maps, self.doubts, self.shape = fitted.maps, doubts, known_shape(world)
        self.camera, _ = camera_geometry(world.ring.sensor)
        self.told = Score(told, shape_deg=self._angle(told)[0], curl_share=doubts.bends.curl())

    def score(self, hypothesis: Hypothesis, trial: Trial) -> Score:
        """Compare with what is told."""
        told, share = self.told, self._curl(hypothesis, trial)
        curl = CURL_WEIGHT * np.log((told.curl_share + CURL_FLOOR) / (share + CURL_FLOOR))
        angle, shape = self._angle(trial)
        shape -= self._angle(told.trial)[1]
        return Score(trial, told.trial.cost - trial.cost, shape, float(curl), angle, share)

    def _angle(self, trial: Trial) -> tuple[float, float]:
        """Give the median angle to a known shape [deg], and the log likelihood of a pixel's."""
        if self.shape is None:
            return 0.0, 0.0
        angle = angular_error_deg(trial.normal, self.shape.reshape(-1, 3)[trial.place])
        return float(np.median(angle)), -float(np.mean(np.log1p((angle / SHAPE_DEG) ** 2)))

    def _curl(self, hypothesis: Hypothesis, trial: Trial) -> float:
        """Give the share of curl in the bends of all pixels, if normals turn as those of the trial do."""
        if hypothesis.move is not None:
            moved = (hypothesis.move(a) for a in (self.maps.normal.astype(float), self.maps.mask))
            return bends_of(*moved, self.camera).curl()
        turn, rigid = turn_between(self.told.trial.normal[:, :2], trial.normal[:, :2])
        return self.doubts.bends.curl(turn) if rigid > RIGID else self.told.curl_share

    def turned(self, hypothesis: Hypothesis, trial: Trial) -> Maps:
        """Give the maps under a hypothesis that turns image or normals."""
        if hypothesis.move is not None:
            return moved(self.maps, hypothesis)
        turn, _ = turn_between(self.told.trial.normal[:, :2], trial.normal[:, :2])
        normal = self.maps.normal.copy()
        normal[..., :2] = normal[..., :2] @ turn.T
        return replace(self.maps, normal=normal)

    def convicts(self, score: Score) -> str:
        """Give the evidence if it leaves no doubt; else nothing."""
        told, scale, before = self.told, score.trial.scale, self.told.trial.scale
        less = (
            f"with that, {scale:.1%} of a threshold stay unexplained of its events, and {before:.1%} as told"
        )
        gain = score.trial.gain if told.trial.gain is None else None
        if gain is not None:
            if not consistently_wrong(gain):
                return ""
            on, off = np.median(gain, axis=0)
            less = f"events say {on:.2g} times C_on and {off:.2g} times C_off; {less}"
        if score.events > GAIN and score.trial.lost < LOST:
            return less
        if score.events < -SLIP:
            return ""
        if self.doubts.shape and score.shape > NORMAL_GAIN and score.shape_deg < LESS * told.shape_deg:
            return (
                f"with that, fitted normals are {score.shape_deg:.0f} degrees off those of the object's geometry, and "
                f"{told.shape_deg:.0f} as told"
            )
        if self.doubts.curl and score.curl > NORMAL_GAIN and score.curl_share < LESS * told.curl_share:
            return (
                f"with that, the curl that no surface has is {score.curl_share:.0%} of the bends of the fitted normals, "
                f"and {told.curl_share:.0%} as told"
            )
        return ""


def consistently_wrong(gain: np.ndarray) -> bool:
    """Tell whether factors (n_pixel, 2) on told thresholds say the same in most pixels."""
    log = np.log(gain)
    middle = np.median(log, axis=0)
    scatter = MEDIAN_TO_SIGMA * np.median(np.abs(log - middle), axis=0)
    far = np.abs(middle) > np.maximum(np.log(WRONG_THRESHOLD), CONSISTENT * scatter)
    return bool(far.any())


def find_error(world: "World", fitted: "Fitted") -> Finding | None:
    """Find what explains that events or normals contradict the files, or remember it."""
    return world.memo("set-up", (fitted,), lambda: _find(world, fitted))


def _find(world: "World", fitted: "Fitted") -> Finding | None:
    doubts = doubts_of(world, fitted)
    found = _tried(world, fitted, doubts) if doubts.any else None
    if found is None and (told := told_by_shadows(world, fitted)):
        found = told.finding(world)
    # A first fit leaves out what surfaces send to each other, which may be as bright
    if found is None and doubts.bright and world.ring.integrator.max_depth <= 1:
        evidence = (
            f"a tenth of the pixels reflect {doubts.reflectance:.1f} times the light that they get, and more"
        )
        return Finding(too_bright(world), evidence)
    return found


def _tried(world: "World", fitted: "Fitted", doubts: Doubts) -> Finding | None:
    """Try hypotheses on some pixels."""
    many, few = list(arrangements(world, doubts)), list(numbers(world, doubts))
    pixel = chosen(world, fitted, [h.move for h in many if h.move])
    if len(pixel) < FEWEST or not (many or few):
        return None
    tried = try_all(world, fitted, pixel, [None, *many])
    judge = Judge(world, fitted, doubts, tried.pop(None))
    totals = {h: judge.score(h, trial).total for h, trial in tried.items()}
    best = leaders(totals)
    if not few and not best:
        return None
    alone = {}
    for h in (None, *few, *best):  # noise and thresholds are learnt from all that are tried together
        alone |= try_all(world, fitted, pixel, [h])
    judge = Judge(world, fitted, doubts, alone.pop(None))
    scores = {h: judge.score(h, trial) for h, trial in alone.items()}
    evidence = {h: judge.convicts(scores[h]) for h in (*many, *few) if h in scores}
    convicted = [h for h, why in evidence.items() if why]
    if not convicted:
        return None
    most = max(scores[h].total for h in convicted)
    tied = [h for h in convicted if scores[h].total > most - TIE]
    if len(tied) > 1 and not world.ring.shape_is_known:
        tied = by_shadows(world, fitted, judge, {h: scores[h].trial for h in tied})
    first, *others = tied
    return Finding(first, evidence[first], tuple(h.what for h in others))


def leaders(totals: dict[Hypothesis, float]) -> list[Hypothesis]:
    """Give the best hypotheses, those that explain as much included."""
    ranked = sorted((h for h in totals if totals[h] > TIE), key=lambda h: -totals[h])
    return [h for k, h in enumerate(ranked[:N_TIED]) if k < N_RUN_OFF or totals[h] > totals[ranked[0]] - TIE]


def by_shadows(
    world: "World", fitted: "Fitted", judge: Judge, tied: dict[Hypothesis, Trial]
) -> list[Hypothesis]:
    """Keep the hypotheses whose surface casts the shadows that the events show: it is hollow under others."""
    pixel = chosen(world, fitted, [h.move for h in tied if h.move], N_SHADED)
    costs = {h: shadow_cost(world, fitted, pixel, h, judge.turned(h, trial)) for h, trial in tied.items()}
    least, most = min(costs.values()), max(costs.values())
    if most - least < SHADED:
        return list(tied)
    return [h for h in tied if costs[h] <= 0.5 * (least + most)]


def shadow_cost(
    world: "World", fitted: "Fitted", pixel: np.ndarray, hypothesis: Hypothesis | None, maps: Maps
) -> float:
    """Give what an event pair costs in the shadows of the surface that a hypothesis makes of a fit; None is what is told."""
    light = world.trace(True, 1, replace(fitted, maps=maps), SURE)
    return try_all(world, fitted, pixel, [hypothesis], light)[hypothesis].cost


@dataclass(frozen=True)
class Hollow:
    """What shadows say of half a turn, which makes a raised surface hollow and leaves no curl.

    Attributes
    ----------
    told, turned, bare : float
        Cost of an event pair in the shadows of the surface as told, of that half a turn away, and without any.
    """

    told: float
    turned: float
    bare: float

    @property
    def gain(self) -> float:
        """Give what the turned one gains."""
        return self.told - self.turned

    @property
    def wrong(self) -> bool:
        """Whether the events show the shadows of the other."""
        return self.gain > HOLLOW and self.bare - self.turned > HOLLOW

    @property
    def doubtful(self) -> bool:
        """Whether they lack those of what is told, which noisy normals may have made, and agree with the other."""
        return not self.wrong and self.gain > HOLLOW and self.turned - self.bare < LITTLE * self.gain

    @property
    def open(self) -> bool:
        """Whether they tell neither."""
        return not (self.wrong or self.doubtful) and self.gain > -HOLLOW

    def finding(self, world: "World") -> Finding | None:
        """Give half a turn if that is it."""
        if not self.wrong:
            return None
        evidence = (
            "with that, raised and hollow change places, and the shadows of the fitted surface explain the events better by "
            f"{self.gain:.2g} of log likelihood an event"
        )
        other = opposite(world.recording.schedule.order, world.ring.leds.n_led)
        return Finding(half_turn(world.recording), evidence, (other,) if other else ())


def told_by_shadows(world: "World", fitted: "Fitted") -> Hollow | None:
    """Ask shadows whether an unknown shape is hollow or raised, or remember it; None of what is flat or too small to tell."""
    return world.memo("hollow", (fitted,), lambda: _told_by_shadows(world, fitted))


def _told_by_shadows(world: "World", fitted: "Fitted") -> Hollow | None:
    maps = fitted.maps
    if world.ring.shape_is_known or np.count_nonzero(maps.mask) < LEAST_PLACES:
        return None
    if np.degrees(np.sqrt(np.var(maps.normal[maps.mask], axis=0).sum())) < VARIED_DEG:
        return None
    half = half_turn(world.recording)
    pixel = chosen(world, fitted, [half.move], N_SHADED)
    if len(pixel) < FEWEST:
        return None
    bare = try_all(world, fitted, pixel, [None, half])
    if half not in bare:  # the object lies elsewhere then
        return None
    costs = (shadow_cost(world, fitted, pixel, h, moved(maps, h)) for h in (None, half))
    return Hollow(*costs, min(trial.cost for trial in bare.values()))


def moved(maps: Maps, hypothesis: Hypothesis | None) -> Maps:
    """Give the maps of an image that is moved."""
    if hypothesis is None:
        return maps
    normal, mask = (np.ascontiguousarray(hypothesis.move(a)) for a in (maps.normal, maps.mask))
    return replace(maps, normal=normal, mask=mask)


def arrangements(world: "World", doubts: Doubts) -> Iterator[Hypothesis]:
    """List how image and ring may lie otherwise, the likelier first among those that explain as much."""
    if doubts.shape or doubts.curl:
        yield from images(world.recording)
    yield from faults(doubts.suspects)
    if doubts.noise > NOISY or doubts.shape or doubts.curl:
        yield from orders(world.recording.schedule.order, world.ring.leds.n_led)


def numbers(world: "World", doubts: Doubts) -> Iterator[Hypothesis]:
    """List which numbers may be others."""
    if doubts.noise > NOISY:
        yield from clocks(world.recording)
        yield from polarities()
    if doubts.thresholds:
        yield from thresholds(world)
    yield from veils(world)


class GrossError:
    """What `find_error` finds: `SetUp` and `Wiring` tell the two kinds of it apart.

    Attributes
    ----------
    leds : bool
        Whether it is of LEDs.
    nothing : str
        Why things are as told, if it is not found.
    """

    name: str
    leds: bool
    nothing: str
    when = "anew"

    def decide(self, asked, world: "World", fitted: "Fitted") -> Decision:
        """Take what explains most, if it leaves no doubt."""
        if world.terms.solver != "lm":
            return Decision(self.name, False, "not looked for by the solver adam")
        if world.metal is not None:
            return Decision(self.name, False, "as told: not looked for on metal")
        found = find_error(world, fitted)
        if found is None or bool(found.hypothesis.leds) != self.leds:
            return Decision(self.name, False, f"as told: {self.nothing}")
        return self.found(asked, found)

    def found(self, asked, found: Finding) -> Decision:
        """Decide on what was found."""
        raise NotImplementedError

    def model(self, world: "World", decision: Decision) -> "World":
        """Take it for true."""
        return decision.answer.hypothesis.mend(world)


class SetUp(GrossError):
    """What is told wrong of the whole set-up; the fit takes it for true only if asked to."""

    name, option, leds = "set-up", "repair", False
    nothing = "nothing contradicts it that another one would explain"

    def decide(self, asked: bool, world: "World", fitted: "Fitted") -> Decision:
        """Say also where a surface may be hollow for all that the recording tells."""
        decision = super().decide(asked, world, fitted)
        if decision.answer is not None or world.terms.solver != "lm" or world.metal is not None:
            return decision
        hollow = told_by_shadows(world, fitted)
        if hollow is None or find_error(world, fitted):
            return decision
        if hollow.doubtful:
            return replace(decision, doubt=DOUBT)
        return replace(decision, why=f"{decision.why}; {OPEN}") if hollow.open else decision

    def found(self, asked: bool, found: Finding) -> Decision:
        """Believe it if asked to."""
        why, remedy = str(found), found.hypothesis.remedy
        more = {"error": found.hypothesis.what, "evidence": found.evidence, "remedy": remedy}
        if not asked:
            return Decision(self.name, False, f"contradicted: {why}", None, more, found)
        warning = f"{why}; the fit took that for true: {remedy}."
        return Decision(self.name, True, f"repaired: {why}", None, more, found, warning)


class Wiring(GrossError):
    """LEDs that do not shine as told; the fit takes that for true."""

    name, option, leds = "wiring", "", True
    nothing = "the events contradict no LED"

    def found(self, asked: str, found: Finding) -> Decision:
        """Believe it."""
        fault = found.hypothesis
        warning = f"{fault.what}, say the events, and the fit took that for true; {fault.remedy}."
        leds = {"leds": list(fault.leds)}
        return Decision(self.name, True, f"{fault.what}, say the events", None, leds, found, warning)
