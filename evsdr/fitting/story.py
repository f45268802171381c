"""The story of a fit: decide on each effect, model those that count, solve, and say what was found."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from evsdr.effects import geometry
from evsdr.effects.payment import paid, widened
from evsdr.effects.world import TRIAL_RAYS, Fitted, Terms, World
from evsdr.fitting import deciding, report, sharing
from evsdr.fitting.checks import as_recorded, check_fit, check_room, object_mask
from evsdr.fitting.decoder import Decoder, start_normals
from evsdr.fitting.entrance import SOLVE, Fit
from evsdr.fitting.following import follow, moves
from evsdr.fitting.model_error import with_model_error
from evsdr.fitting.presets import PRESETS
from evsdr.fitting.settings import Settings
from evsdr.fitting.settling import settle
from evsdr.fitting.sharing import FAR
from evsdr.fitting.tiles import largest, solve_tiles, telling
from evsdr.fitting.tiling import tiles_of
from evsdr.fitting.verdict import judge
from evsdr.light.scene import RingScene
from evsdr.light.tracing import trace_illumination
from evsdr.metrics import angular_error_deg
from evsdr.progress import Progress, Seconds
from evsdr.records import Recording
from evsdr.solve.shared.rig import Told

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
        return deciding.decide("first", replace(world, enough=stages.ask), None, settings)[0]


def believe(world: World, settings: Settings, stages: Seconds) -> tuple[World, Fitted, Fitted, Decoder, dict]:
    """Decide on all effects, and fit.

    Gives what is believed, the fit, the one before lobes were put in, what solves under it, and notes for the summary.
    """
    with stages.stage("pair events"):
        world.pairs()
    with stages.stage("check recording"):
        world, _ = deciding.decide("scene", world, None, settings)
        geometry.check_light(world)
    solve = Decoder(world.ring, settings, start_normals(world.ring, settings.init), world.thresholds)
    thorough = world.terms.thorough
    first = "rough" if thorough else "search"
    with stages.stage(SOLVE) as advance:
        fitted = solve(world.problem(), None, first, advance)
        world, changed = deciding.decide("anew", world, fitted, settings, advance)
        if changed:
            solve = replace(solve, thresholds=world.thresholds)
            fitted = solve(world.problem(), None, "metal" if world.metal else first, advance)
    told = world
    with stages.stage("neighbours") as advance:
        settle_them = sharing.settle_events if thorough else sharing.settle_events_at_once
        world, fitted = settle_them(world, fitted, settings, solve, advance)
    notes = {}
    with stages.stage("settle light") as advance:
        first_light = world.illumination()
        world, changed = deciding.decide("together", world, fitted, settings, advance)
        one_look = world.shadows == "latent" and not thorough
        if world.light_follows_fit and not (one_look or stages.enough):
            world, fitted, notes = settle(world, first_light, fitted, solve, advance)
        last = "light" if changed else "again"
        if world.moved or world.shadows == "latent":
            if changed:
                fitted, last = solve(world.problem(fitted), fitted, "relit", advance), "again"
            world, fitted, _ = sharing.share_anew(told, world, fitted, settings, advance)
        fitted = solve(world.problem(fitted), fitted, last, advance)
        fitted = follow(world, fitted, solve, advance)
    matt = fitted
    with stages.stage("residuals") as advance:
        world, fitted = model_residuals(told, world, fitted, settings, solve, advance)
    return world, fitted, matt, solve, notes


def model_residuals(
    told: World, world: World, fitted: Fitted, settings: Settings, solve: Decoder, progress: Progress
) -> tuple[World, Fitted]:
    """Model what the residuals of maps show of the surface, and refine it in those of the maps that it gives.

    `told` is what was believed before pixels were asked what they share. Where what was found is not there once it is modelled, all is
    as it was before.
    """
    plain, matt = world, fitted
    for turn in range(MOST_MODELS):
        before = fitted
        world, changed = deciding.decide("settled", world, fitted, settings, progress)
        if taken_back := {d.effect: d for d in world.decisions.values() if d.taken_back}:
            taken_back = {name: replace(d, taken_back=False) for name, d in taken_back.items()}
            world, fitted = replace(plain, decisions=plain.decisions | taken_back), matt
            continue
        if changed:
            fitted = solve(world.problem(fitted), fitted, "model", progress)
        if turn and turned_deg(before, fitted) < max(FAR * world.terms.limit_deg, UNSEEN * open_deg(fitted)):
            break
        if changed and (world.terms.thorough or world.gloss):  # which passes for other thresholds and times
            world, fitted, changed = sharing.share_anew(told, world, fitted, settings, progress)
            if changed:
                fitted = solve(world.problem(fitted), fitted, "again", progress)
                fitted = follow(world, fitted, solve, progress)
    return world, fitted


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
    believed, _ = deciding.decide("last", believed, fitted, settings)
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


def turned_deg(before: Fitted, fitted: Fitted) -> float:
    """Give the mean angle [deg] between the normals that two fits know."""
    known = before.maps.mask & fitted.maps.mask
    angle = angular_error_deg(before.maps.normal[known], fitted.maps.normal[known])
    return float(angle.mean()) if len(angle) else 0.0


def open_deg(fitted: Fitted) -> float:
    """Give the median sigma [deg] of the normals that a fit knows."""
    sigma = fitted.maps.normal_sigma_deg[fitted.maps.mask]
    return float(np.median(sigma)) if len(sigma) else 0.0
