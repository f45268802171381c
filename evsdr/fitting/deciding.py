"""All effects in their order, and the decisions on those of a time."""

from dataclasses import replace

from evsdr.effects.background import BackgroundActivity
from evsdr.effects.clock import ClockStep, SlotLength, TimeShift
from evsdr.effects.gloss import GlossOrPowers, GlossyLobes
from evsdr.effects.hot_pixels import HotPixels
from evsdr.effects.indirect import IndirectLight
from evsdr.effects.lag import PhotoreceptorLag
from evsdr.effects.leak import Leak
from evsdr.effects.leds import LedDirections, LedPowers
from evsdr.effects.metal import Metal, RoughnessOfMetal
from evsdr.effects.near_leds import DepthOfNearLeds, DistanceOfNearLeds, NearLeds
from evsdr.effects.outline import Outline
from evsdr.effects.rays import Rays, RaysOnFit
from evsdr.effects.refractory import Refractory
from evsdr.effects.rough import RoughMatt
from evsdr.effects.setup import SetUp, Wiring
from evsdr.effects.shadows import Shadows, ShadowsInEvents, ShadowsOnFit, ShadowsOrGloss
from evsdr.effects.thresholds import Thresholds, ThresholdScale, ThresholdsUnderVeil
from evsdr.effects.translucent import Translucency
from evsdr.effects.world import Fitted, World
from evsdr.fitting.settings import Settings
from evsdr.progress import Progress, silent

EFFECTS = (
    Outline(),
    NearLeds(),
    Shadows(),
    Rays(),
    ClockStep(),
    SlotLength(),
    HotPixels(),
    Thresholds(),
    Metal(),
    BackgroundActivity(),
    SetUp(),
    Wiring(),
    ThresholdsUnderVeil(),
    LedPowers(),
    LedDirections(),
    DistanceOfNearLeds(),
    TimeShift(),
    Refractory(),
    Leak(),
    ThresholdScale(),
    PhotoreceptorLag(),
    ShadowsOnFit(),
    ShadowsInEvents(),
    DepthOfNearLeds(),
    RaysOnFit(),
    IndirectLight(),
    RoughnessOfMetal(),
    RoughMatt(),
    GlossyLobes(),
    ShadowsOrGloss(),
    Translucency(),
    GlossOrPowers(),
)


def decide(
    when: str, world: World, fitted: Fitted | None, settings: Settings, progress: Progress = silent
) -> tuple[World, bool]:
    """Decide on all effects of a time, in order; gives the world with those that count, and whether any does.

    Where `progress` gives True nothing is decided: the world stays that of the fit.
    """
    before, changed = world, False
    effects = [effect for effect in EFFECTS if effect.when == when]
    for k, effect in enumerate(effects):
        if progress(f"decide on {effect.name}", (k + 1) / len(effects)):
            return before, False
        decision = effect.decide(getattr(settings, effect.option, "auto"), world, fitted)
        if decision is None:
            continue
        world = replace(world, decisions=world.decisions | {decision.effect: decision})
        if decision.modelled:
            world, changed = effect.model(world, decision), True
    return world, changed
