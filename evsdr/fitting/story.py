"""The story of a fit: look, decide, solve, and say what was found."""

from pathlib import Path

import numpy as np

from evsdr.effects import (
    geometry,
    hot_pixels,
    lag,
    light_choice,
    refractory,
    thresholds,
    transport,
    wiring,
)
from evsdr.effects.gloss import solve_gloss
from evsdr.effects.world import Observations
from evsdr.errors import InputError
from evsdr.events.pairs import pair_events
from evsdr.fitting import decoder, report
from evsdr.fitting.checks import check_fit, object_mask
from evsdr.fitting.entrance import Fit
from evsdr.fitting.presets import PRESETS
from evsdr.fitting.settings import Settings
from evsdr.light.camera import view_directions
from evsdr.light.scene import RingScene
from evsdr.progress import Seconds
from evsdr.records import Recording


def fit_recording(
    ring: RingScene,
    recording: Recording,
    settings: Settings,
    wanted: np.ndarray | str | Path | None,
    stages: Seconds,
) -> Fit:
    """Fit a recording of a scene; arguments as of `entrance.fit`, whose work this is."""
    check_fit(ring, recording, settings)
    preset = PRESETS[settings.preset]
    with stages.stage("trace light"):
        asked = light_choice.Asked(
            settings.shadows, settings.leds, settings.light_paths, preset.rays, settings.seed + 1
        )
        traced = light_choice.first_light(ring, asked)
        light, mask = traced.illumination, object_mask(ring, traced.coverage, wanted)
        geometry.check_light(ring, traced, mask, ring.path)
        geometry.check_pieces(ring, asked, mask, ring.path)
        start_normal = decoder.start_normals(ring, settings.init)
    with stages.stage("pair events"):
        try:
            pairs = pair_events(recording, mask)
        except InputError as error:
            raise InputError(f"{recording.source}: {error}") from error
    with stages.stage("check recording"):
        seen = Observations(recording, mask, pairs, hot_pixels.impossible_rate(recording, light))
        unknown, threshold_note = thresholds.choose_thresholds(
            settings.thresholds, settings.solver, recording, ring
        )
        seen, period = refractory.choose_refractory(settings.refractory, seen, light, unknown)
    solve = decoder.Decoder(ring, settings, start_normal, unknown)
    late, lag_note = lag.looks_for_lag(settings.lag, settings.solver, preset.thorough)
    found = None
    purpose = "alone" if late else "whole"
    with stages.stage("solve") as advance:
        fitted = solve(seen.under(light), None, purpose, advance)
        fault = None
        if settings.solver == "lm":
            fault = wiring.find_fault(fitted.problem.pairs, fitted.problem.illumination, fitted.solution)
        if fault:
            report.warn_of_fault(recording.source, fault)
            seen = seen.in_order(fault.mend(seen.recording.schedule.order))
            fitted = solve(seen.under(light), None, purpose, advance)
    if late:
        with stages.stage("lag, neighbours") as advance:
            known = seen.recording, fitted.problem, fitted.solution
            purpose, found = "learn", lag.find_lag(*known, unknown)
            if found:
                purpose, lag_note = "again", str(found)
                seen = seen.behind(lag.photoreceptors(*known, found))
            fitted = solve(seen.under(light), fitted, purpose, advance)
    with stages.stage("settle light") as advance:

        def refit(light, fitted, quick):
            if quick or not found:
                return solve(seen.under(light), fitted, "quick" if quick else "light", advance)
            receptors = lag.photoreceptors(seen.recording, fitted.problem, fitted.solution, found)
            return solve(seen.behind(receptors).under(light), fitted, "light", advance)

        traced, fitted = transport.settle(ring, traced, asked, fitted, refit, advance)
    gloss = "angular gate, as published" if settings.solver == "adam" else "not looked for by the preset fast"
    if settings.solver == "lm" and (preset.thorough or settings.gloss != "auto"):
        with stages.stage("gloss") as advance:
            view = view_directions(ring, fitted.problem.pixel)
            effort = decoder.choose_effort(settings)
            solution, gloss = solve_gloss(
                settings.gloss, fitted.problem, fitted.solution, effort, view, advance
            )
            fitted = solve.fitted(fitted.problem, solution)
    with stages.stage("surface"):
        surface = transport.surface_of(ring, fitted) if fitted.maps.mask.any() else {}
    geometry.check_normals(ring, traced, asked, fitted.maps, ring.path)
    report.warn_of_what_was_found(ring, seen, fitted)
    notes = traced.notes | {
        "bands": report.band_note(seen.recording, ring),
        "gloss": gloss,
        **report.solver_notes(settings, fitted.solution),
        "contrast thresholds": threshold_note,
        "photoreceptor lag": lag_note,
        "scale": report.scale_note(ring),
    }
    summary = report.summarise(ring, settings, notes, seen, fitted, period)
    return Fit(fitted.maps, fitted.solution, summary, surface)
