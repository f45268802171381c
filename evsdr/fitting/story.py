"""The story of a fit: read, look, decide, solve, and say what was found."""

import sys
import warnings

from evsdr.errors import InputError, InputWarning, check_range, parse_definitions
from evsdr.events.pairs import pair_events
from evsdr.files.events_h5 import read_recording
from evsdr.files.truth import read_truth
from evsdr.fitting.checks import check_fit, object_mask, parse_priors
from evsdr.metrics import score
from evsdr.progress import Stages
from evsdr.records import Maps

MOST_RAYS = {"fast": 4, "balanced": 16, "accurate": 64}  # per pixel, for visibility


def fit(options) -> tuple[Maps, dict]:
    """Recover maps from a recording: `recover` without the surface."""
    return recover(options)[:2]


def recover(options) -> tuple[Maps, dict, dict]:
    """Recover maps and surface from a recording.

    Parameters
    ----------
    options : Options
        As on the command line.

    Returns
    -------
    maps : Maps
    summary : dict
        What was modelled and why, numbers, seconds per stage, residuals, and errors if a truth is given.
    surface : dict of callable (path)
        What writes `depth.exr` and `mesh.ply`; empty where no pixel is known.

    Raises
    ------
    InputError
        Something given can't be used.
    """
    with warnings.catch_warnings(record=True) as caught, Stages("fit") as stages:
        warnings.simplefilter("always", InputWarning)
        try:
            maps, summary, surface = _fit(options, stages)
        finally:
            messages = list(dict.fromkeys(str(w.message) for w in caught))
            for message in messages:
                print(f"warning: {message}", file=sys.stderr)
    return maps, summary | {"warnings": messages, "seconds": stages.seconds}, surface


def _fit(options, stages: Stages) -> tuple[Maps, dict, dict]:
    check_range("--seed", options.seed, 0)
    priors = parse_priors(options.priors)
    with stages.stage("start"):
        from evsdr import jit

        jit.start("cuda_ad_spectral" if options.device == "gpu" else "llvm_ad_spectral")
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
        from evsdr.fitting import decoder, report
        from evsdr.light.camera import view_directions
        from evsdr.light.scene import load_scene
    with stages.stage("read events"):
        recording = read_recording(options.events)
    with stages.stage("load scene"):
        ring = load_scene(options.scene, parse_definitions(options.define))
        check_fit(ring, recording, options)
        truth = None
        if options.truth:
            truth = read_truth(options.truth, ring.height, ring.width, ring.leds.n_band)
    with stages.stage("trace light"):
        asked = light_choice.Asked(
            options.shadows, options.leds, options.light_paths, MOST_RAYS[options.preset], options.seed + 1
        )
        traced = light_choice.first_light(ring, asked)
        light, mask = traced.illumination, object_mask(options, traced.coverage)
        geometry.check_light(ring, traced, mask, options.scene)
        geometry.check_pieces(ring, asked, mask, options.scene)
        start_normal = decoder.start_normals(ring, options.init)
    with stages.stage("pair events"):
        try:
            pairs = pair_events(recording, mask)
        except InputError as error:
            raise InputError(f"{options.events}: {error}") from error
    with stages.stage("check recording"):
        seen = Observations(recording, mask, pairs, hot_pixels.impossible_rate(recording, light))
        unknown, threshold_note = thresholds.choose_thresholds(
            options.thresholds, options.solver, recording, ring
        )
        seen, period = refractory.choose_refractory(options.refractory, seen, light, unknown)
    solve = decoder.Decoder(ring, options, priors, start_normal, unknown)
    late, lag_note = lag.looks_for_lag(options)
    found = None
    purpose = "alone" if late else "whole"
    with stages.stage("solve") as advance:
        fitted = solve(seen.under(light), None, purpose, advance)
        fault = None
        if options.solver == "lm":
            fault = wiring.find_fault(fitted.problem.pairs, fitted.problem.illumination, fitted.solution)
        if fault:
            report.warn_of_fault(options.events, fault)
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
    gloss = "angular gate, as published" if options.solver == "adam" else "not looked for by the preset fast"
    if options.solver == "lm" and (options.preset, options.gloss) != ("fast", "auto"):
        with stages.stage("gloss") as advance:
            view = view_directions(ring, fitted.problem.pixel)
            effort = decoder.choose_effort(options, priors)
            solution, gloss = solve_gloss(
                options.gloss, fitted.problem, fitted.solution, effort, view, advance
            )
            fitted = solve.fitted(fitted.problem, solution)
    with stages.stage("surface"):
        surface = transport.surface_of(ring, fitted) if fitted.maps.mask.any() else {}
    geometry.check_normals(ring, traced, asked, fitted.maps, options.scene)
    report.warn_of_what_was_found(options, ring, seen, fitted)
    notes = traced.notes | {
        "bands": report.band_note(seen.recording, ring),
        "gloss": gloss,
        **report.solver_notes(options.solver, priors, fitted.solution),
        "contrast thresholds": threshold_note,
        "photoreceptor lag": lag_note,
        "scale": report.scale_note(ring),
    }
    summary = report.summarise(options, notes, seen, fitted, period)
    if truth is not None:
        summary["error"] = score(fitted.maps, truth)
        summary |= summary["error"]
    return fitted.maps, summary, surface
