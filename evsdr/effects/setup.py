"""Gross errors of a set-up: tried where something speaks against what is told, and believed if they explain it.

A hypothesis is worth the log likelihood that it gains over what is told: of the events of some pixels that are fitted
anew under it, and of their normals, by a known shape and by the curl of the slopes.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from evsdr.effects.crossfade import find_crossfade
from evsdr.effects.doubts import NOISY, Doubts, doubts_of
from evsdr.effects.effect import Decision
from evsdr.effects.evidence import Judge
from evsdr.effects.hollow import DOUBT, FEWEST, N_SHADED, OPEN, shadow_cost, told_by_shadows
from evsdr.effects.hypotheses import (
    Finding,
    Hypothesis,
    clocks,
    faults,
    images,
    orders,
    polarities,
    thresholds,
    too_bright,
    veils,
)
from evsdr.effects.trials import Trial, chosen, try_all

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World

SHADED = 1e-3  # cost of an event pair that tells shadows; measured: 0.002 to 0.1
# Hypotheses that are tried once more, each by itself, and at most if they explain as much
N_RUN_OFF, N_TIED = 3, 6
TIE = 0.5  # of log likelihood of a pixel: hypotheses as near to the best explain as much


def find_error(world: "World", fitted: "Fitted") -> Finding | None:
    """Find what explains that events or normals contradict the files, or remember it."""
    return world.memo("set-up", (fitted,), lambda: _find(world, fitted))


def _find(world: "World", fitted: "Fitted") -> Finding | None:
    doubts = doubts_of(world, fitted)
    found = _tried(world, fitted, doubts) if doubts.any else None
    if found is None and doubts.fading:
        found = find_crossfade(world, fitted)
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
