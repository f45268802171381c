"""The story of a fit: decide on each effect, model those that count, solve, and say what was found."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from evsdr.effects import geometry
from evsdr.effects.background import BackgroundActivity
from evsdr.effects.blocks import sample_of
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
from evsdr.effects.payment import paid, widened
from evsdr.effects.rays import Rays, RaysOnFit
from evsdr.effects.refractory import Refractory
from evsdr.effects.rough import RoughMatt
from evsdr.effects.setup import SetUp, Wiring
from evsdr.effects.shadows import Shadows, ShadowsInEvents, ShadowsOnFit, ShadowsOrGloss
from evsdr.effects.shared import SharedFound, find_shared, last_found
from evsdr.effects.thresholds import Thresholds, ThresholdScale, ThresholdsUnderVeil
from evsdr.effects.translucent import Translucency
from evsdr.effects.world import TRIAL_RAYS, Fitted, Terms, World
from evsdr.fitting import report
from evsdr.fitting.checks import as_recorded, check_fit, check_room, object_mask
from evsdr.fitting.decoder import Decoder, start_normals
from evsdr.fitting.entrance import SOLVE, Fit
from evsdr.fitting.following import follow, moves
from evsdr.fitting.model_error import with_model_error
from evsdr.fitting.presets import PRESETS
from evsdr.fitting.settings import Settings
from evsdr.fitting.settling import settle
from evsdr.fitting.tiles import largest, solve_tiles, telling
from evsdr.fitting.tiling import tiles_of
from evsdr.fitting.verdict import judge
from evsdr.light.scene import RingScene
from evsdr.light.tracing import trace_illumination
from evsdr.metrics import angular_error_deg
from evsdr.progress import Progress, Seconds, silent
from evsdr.records import Recording
from evsdr.solve.shared.rig import Told

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
MOST_SKETCHES = 2  # each under what the maps before tell that pixels share
FEW = 1000  # pixels that show whether what is inferred explains them, where there is one look only; guessed
KEPT = 0.5  # of the pixels that are known, at least, when what they share was inferred; guessed
FAR = 2.0  # limits by which better maps must turn normals, by what pixels share, to be worth another fit; guessed
# The same of the logarithms of reflectances and thresholds; guessed. Measured on a blob of experiments.table1 after its lobe was
# found: 0.05, RMSE 0.030 -> 0.010
RESCALED = 0.02
MOST_MODELS = 5  # of the surface, by residuals of maps under the one before; guessed
# Of the median sigma of normals: what turns them by less is not worth another model; guessed. Measured (`experiments.draws`, 23 and 209), degrees after
# each model: 1.74 1.59 1.64 1.63 1.62 and 5.77 5.78 5.81 5.81 5.87, where they turn by .84 .18 .11 .07 and .72 .35 .24 .32
UNSEEN = 0.2


def world_of(
    ring: RingScene,
    recording: Recording,
    settings: Settings,
    wanted: np.ndarray | str | Path | None,
    stages: Seconds,
) -> World:
    """Believe what scene and recording tell, once they are checked; arguments as of `entrance.fit`."""
    check_fit(ring, recording, settings)
    ring, recording = as_recorded(ring, recording)
    terms = terms_of(settings)
    with stages.stage("trace light"):
        _, coverage = trace_illumination(ring, TRIAL_RAYS, False, terms.seed)
        mask = object_mask(ring, coverage, wanted)
        told = ring.shape_is_known or wanted is not None
        world = World.before_a_fit(ring, recording, mask, terms, told)
        return decide("first", replace(world, enough=stages.ask), None, settings)[0]


def believe(world: World, settings: Settings, stages: Seconds) -> tuple[World, Fitted, Fitted, Decoder, dict]:
    """Decide on all effects, and fit.

    Gives what is believed, the fit, the one before lobes were put in, what solves under it, and notes for the summary.
    """
    with stages.stage("pair events"):
        world.pairs()
    with stages.stage("check recording"):
        world, _ = decide("scene", world, None, settings)
        geometry.check_light(world)
    solve = Decoder(world.ring, settings, start_normals(world.ring, settings.init), world.thresholds)
    thorough = world.terms.thorough
    first = "rough" if thorough else "search"
    with stages.stage(SOLVE) as advance:
        fitted = solve(world.problem(), None, first, advance)
        world, changed = decide("anew", world, fitted, settings, advance)
        if changed:
            solve = replace(solve, thresholds=world.thresholds)
            fitted = solve(world.problem(), None, "metal" if world.metal else first, advance)
    told = world
    with stages.stage("neighbours") as advance:
        settle_them = settle_events if thorough else settle_events_at_once
        world, fitted = settle_them(world, fitted, settings, solve, advance)
    notes = {}
    with stages.stage("settle light") as advance:
        first_light = world.illumination()
        world, changed = decide("together", world, fitted, settings, advance)
        one_look = world.shadows == "latent" and not thorough
        if world.light_follows_fit and not (one_look or stages.enough):
            world, fitted, notes = settle(world, first_light, fitted, solve, advance)
        last = "light" if changed else "again"
        if world.moved or world.shadows == "latent":
            if changed:
                fitted, last = solve(world.problem(fitted), fitted, "relit", advance), "again"
            world, fitted, _ = share_anew(told, world, fitted, settings, advance)
        fitted = solve(world.problem(fitted), fitted, last, advance)
        fitted = follow(world, fitted, solve, advance)
    matt = fitted
    with stages.stage("residuals") as advance:
        for turn in range(MOST_MODELS):
            world, changed = decide("settled", world, fitted, settings, advance)
            before = fitted
            if changed:
                fitted = solve(world.problem(fitted), fitted, "model", advance)
            if turn and turned_deg(before, fitted) < max(
                FAR * world.terms.limit_deg, UNSEEN * open_deg(fitted)
            ):
                break
            if changed and (thorough or world.gloss):  # which passes for other thresholds and times
                world, fitted, changed = share_anew(told, world, fitted, settings, advance)
                if changed:
                    fitted = solve(world.problem(fitted), fitted, "again", advance)
                    fitted = follow(world, fitted, solve, advance)
    return world, fitted, matt, solve, notes


def fit_recording(
    ring: RingScene,
    recording: Recording,
    settings: Settings,
    wanted: np.ndarray | str | Path | None,
    stages: Seconds,
    everywhere: bool = True,
) -> Fit:
    """Fit a recording of a scene; arguments as of `entrance.fit`, whose work this is.

    Of one that takes tiles only the pixels that tell what all share are solved, unless `everywhere`.
    """
    world = world_of(ring, recording, settings, wanted, stages)
    tiles = tiles_of(world.mask, world.recording.events) if settings.solver == "lm" else []
    check_room(world.recording, largest(tiles, world) if tiles else world.mask)
    part = telling(world) if tiles else world
    believed, fitted, matt, solve, notes = believe(part, settings, stages)
    believed, _ = decide("last", believed, fitted, settings)
    with stages.stage("signals"):
        fitted, signals, misfit = with_model_error(believed, fitted, matt, solve)
        moved = moves(believed, fitted)
    world = replace(believed, mask=world.mask if everywhere else part.mask)
    if tiles and everywhere:
        with stages.stage("tiles") as advance:
            fitted = solve_tiles(world, tiles, fitted, partial(retell, solve), advance)
    stopped = stages.enough
    fitted = replace(fitted, maps=paid(widened(fitted, world), world.decisions))
    with stages.stage("surface"):
        depth = world.surface.depth(fitted, world.nearer) if fitted.maps.mask.any() else None
        surface = world.surface.files(depth, fitted.maps) if depth else {}
    geometry.check_pieces(world)
    geometry.check_normals(world, fitted.maps)
    verdict = judge(world, fitted, stopped, misfit.least, moved)
    said = {"verdict": str(verdict), "stopped": stopped, "misfit": misfit.words}
    summary = report.summarise(world, settings, fitted, notes) | world.surface.told() | said
    whole = len(signals.pixel) == fitted.problem.n_pixel
    shown = signals if whole and not tiles else None
    return Fit(fitted.maps, world.decisions, fitted.solution, summary, surface, depth, shown)


def retell(solve: Decoder, world: World, progress: Progress) -> Fitted:
    """Fit other pixels under what is believed. What they see of the LEDs, if events tell that, is asked once maps are worth it."""
    matt, gloss, hidden = replace(world, gloss=None), world.gloss, world.shadows == "latent"
    plain = replace(matt, shadows="scene" if world.ring.shape_is_known else "none") if hidden else matt
    first = "metal" if world.metal else "search" if world.lag else "whole"
    fitted = solve(plain.problem(), None, first, progress)
    if world.lag:
        fitted = replace(solve(plain.problem(fitted), fitted, "touch", progress), problem=fitted.problem)
    if hidden:
        fitted = solve(plain.problem(fitted), fitted, "sketch", progress)
    elif first != "whole":
        fitted = solve(plain.problem(fitted), fitted, "again" if world.lag else "learn", progress)
        fitted = follow(matt, fitted, solve, progress)
    again = hidden and world.terms.thorough
    if world.light_follows_fit:
        if again or not hidden:
            matt, fitted, _ = settle(matt, plain.illumination(), fitted, solve, progress)
        fitted = solve(matt.problem(fitted), fitted, "relit" if again else "light", progress)
    if again:
        fitted = solve(matt.problem(fitted), fitted, "again", progress)
    if hidden:
        fitted = follow(matt, fitted, solve, progress)
    before = fitted
    if gloss:
        glossy = replace(matt, gloss=gloss.commonest(fitted.problem.n_pixel))
        fitted = solve(glossy.problem(fitted), fitted, "model", progress)
    return with_model_error(world, fitted, before, solve)[0]


def terms_of(settings: Settings) -> Terms:
    """Give the terms by which effects are decided on."""
    preset, lm = PRESETS[settings.preset], settings.solver == "lm"
    thorough, told = preset.thorough and lm, Told(directions_deg=settings.leds_told_to)
    given = settings.solver, thorough, settings.limit_deg, preset.rays, settings.seed + 1
    return Terms(*given, unknown_of_all(settings), told)


def unknown_of_all(settings: Settings) -> tuple[str, ...]:
    """Give what all pixels share and is unknown, see `Settings.shared`."""
    as_told = {
        "lag": settings.lag == "off",
        "refractory": settings.refractory == "known",
        "thresholds": settings.thresholds == "known",
        "directions": settings.leds_told_to == 0,
    }
    return tuple(name for name in settings.shared if not as_told.get(name))


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


def settle_events(
    world: World, fitted: Fitted, settings: Settings, solve: Decoder, progress: Progress
) -> tuple[World, Fitted]:
    """Infer what pixels share, from rough maps and from sketches under what those before tell.

    Where pixels are many they are some. Maps of pixels by which that is inferred move with it, and the others' alike. All are
    sketched under it where the maps shall tell what shape casts shadows.
    """
    told, teacher, sketch = world, sample_of(fitted), None
    for _ in range(MOST_SKETCHES):
        new, changed = decide("alone", told, teacher, settings, progress)
        found = find_shared(told, teacher)
        if not changed or sketch and not moves_far(found, world):
            world = world if sketch else new
            break
        before = moved_with(found, teacher)
        after = sketch_under(new, before, solve, progress)
        if loses(before, after):
            world = world if sketch else refuse(told, new)
            break
        world, told, fitted, sketch = new, replace(told, found=found), moved_with(found, fitted), after
        teacher = replace(sketch, problem=before.problem)
    if sketch and sketch.problem.n_pixel == fitted.problem.n_pixel:
        return world, sketch
    if sketch and world.ring.shape_is_known:
        return world, fitted
    return world, solve(world.problem(fitted), fitted, "sketch", progress)


def settle_events_at_once(
    world: World, fitted: Fitted, settings: Settings, solve: Decoder, progress: Progress
) -> tuple[World, Fitted]:
    """Infer what pixels share from rough maps, and let those move with it; sketches of a few pixels show whether that explains them.

    Where LEDs are not as told maps were bent by that, and the sketches are asked once more. Measured in fast fits of `experiments.draws` whose powers
    were 10 % off: 16, 24, 6, 4 18.3 7.9 6.7 14.9 -> 9.9 3.4 4.9 11.6 degrees, 21 6.2 -> 7.3, of 14 more none by more than scatter.
    """
    new, changed = decide("alone", world, fitted, settings, progress)
    if not changed:
        return new, fitted
    moved = moved_with(find_shared(world, fitted), fitted)
    some = sample_of(moved, FEW)
    sketch = sketch_under(new, some, solve, progress)
    if loses(some, sketch):
        return refuse(world, new), fitted
    moved = replace(moved, solution=replace(moved.solution, noise=sketch.solution.noise))
    if new.aim is world.aim:
        return new, moved
    told, teacher = replace(world, found=find_shared(world, fitted)), replace(sketch, problem=some.problem)
    new, _ = decide("alone", told, teacher, settings, progress)
    return new, moved_with(find_shared(told, teacher), moved)


def sketch_under(world: World, fitted: Fitted, solve: Decoder, progress: Progress) -> Fitted:
    """Sketch the pixels of a fit under what is believed."""
    world = replace(world, mask=fitted.problem.grid.mask)
    return solve(world.problem(fitted), fitted, "sketch", progress)


def loses(before: Fitted, after: Fitted) -> bool:
    """Say whether another fit knows too few of the pixels that one knew."""
    known = before.maps.mask[before.problem.grid.mask]
    return np.count_nonzero(known & after.maps.mask[before.problem.grid.mask]) < KEPT * known.sum()


def turned_deg(before: Fitted, fitted: Fitted) -> float:
    """Give the mean angle [deg] between the normals that two fits know."""
    known = before.maps.mask & fitted.maps.mask
    angle = angular_error_deg(before.maps.normal[known], fitted.maps.normal[known])
    return float(angle.mean()) if len(angle) else 0.0


def open_deg(fitted: Fitted) -> float:
    """Give the median sigma [deg] of the normals that a fit knows."""
    sigma = fitted.maps.normal_sigma_deg[fitted.maps.mask]
    return float(np.median(sigma)) if len(sigma) else 0.0


def moves_far(found: SharedFound | None, world: World) -> bool:
    """Say whether what pixels share moves their maps by enough for another fit."""
    if found is None:
        return False
    scale = np.abs(found.moved[2:]).max(initial=0)
    return found.inferred.moved_deg >= FAR * world.terms.limit_deg or scale > RESCALED


def moved_with(found: SharedFound | None, fitted: Fitted) -> Fitted:
    """Let all pixels' reflectances and thresholds move as those by which what they share was inferred."""
    return replace(fitted, solution=fitted.solution.moved(found.moved)) if found else fitted


def share_anew(
    told: World, world: World, fitted: Fitted, settings: Settings, progress: Progress
) -> tuple[World, Fitted, bool]:
    """Infer what pixels share once more, now that the light's model is another; `told` is the world before any was inferred.

    Gives also whether that asks for another fit. It starts from what was found last, as maps are of that. Measured on a sphere (`experiments.draws`,
    --seeds 587 --but power=0 slot_us=15000 crossfade=1 perspective=False event_noise=.02 refractory_us=20 told_threshold=1): from what is told, which is
    LEDs .67 too far for these maps, departures took up what was wrong, and normals went from .3 to 8 degrees off.
    """
    same = world, fitted, False
    if not world.terms.shared:  # what follows would look for hidden LEDs once more
        return same
    as_told = {name: getattr(told, name) for name in ("recording", "lag", "leak", "aim", "nearer")}
    last = last_found(world.decisions)
    before = replace(world, found=last and replace(last, off=None), **as_told)
    looked = before.with_seen(fitted)
    teacher = replace(looked, problem=before.problem(looked))
    new, changed = decide("alone", before, teacher, settings, progress)
    if new is before:  # as told to stop
        return same
    found = find_shared(before, teacher)
    if not changed and not moves_far(found, world):
        return same
    return new, moved_with(found, looked), True


def refuse(told: World, world: World) -> World:
    """Take back what a world believes beyond what was told: with it, too few pixels can be explained."""
    why = "as told: with what the events seem to tell fewer pixels can be explained"
    new = {name: d for name, d in world.decisions.items() if told.decisions.get(name) is not d}
    taken = {name: replace(d, modelled=False, why=why) for name, d in new.items() if d.modelled}
    return replace(told, decisions=world.decisions | taken)
