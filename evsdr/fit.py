"""`python -m evsdr.fit scene.xml events.h5`: recover normals and absolute reflectance from a recording."""

import sys
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from evsdr.console import Stages, check_range, parse_definitions, print_table, run_command
from evsdr.errors import InputError, InputWarning
from evsdr.files import check_folder
from evsdr.fit_input import check_fit, object_mask, parse_priors
from evsdr.metrics import read_truth, score
from evsdr.pairs import pair_events
from evsdr.recording import read_recording
from evsdr.records import Maps
from evsdr.results import write_results


@dataclass(frozen=True)
class Options:
    """Recover surface normals and absolute spectral reflectance from events under a ring of LEDs."""

    scene: tyro.conf.Positional[Path]
    """Scene file: camera, LEDs, object."""
    events: tyro.conf.Positional[Path]
    """Recording, an events.h5."""
    out: Path | None = None
    """Folder for the results; by default named after the recording."""
    truth: Path | None = None
    """truth.npz to compare with."""
    preset: Literal["fast", "balanced", "accurate"] = "balanced"
    """Speed against accuracy."""
    solver: Literal["lm", "adam"] = "lm"
    """Per-pixel Levenberg-Marquardt, or the decoder of the EventSpecPS paper."""
    shadows: Literal["auto", "off", "scene", "estimate", "downweight"] = "auto"
    """Cast shadows: left out, traced on the scene's geometry, traced on the depth that the fitted normals give,
    down-weighted as outliers, or decided from what they would change."""
    leds: Literal["auto", "near", "far"] = "auto"
    """LEDs at finite distance: direction and fall-off per pixel, one for all pixels, or decided from the parallax."""
    light_paths: Literal["auto", "direct", "indirect"] = "auto"
    """Light by way of other surfaces; auto models it where max_depth of the scene is above 1 and it counts."""
    gloss: Literal["auto", "off", "lobe", "blinn-phong", "gate"] = "auto"
    """Highlights: left out, a rough dielectric coating or a Blinn-Phong lobe fitted with the maps, the angular gate of
    the EventSpecPS paper, or decided from the residuals: the coating, or nothing."""
    thresholds: Literal["auto", "known", "estimate"] = "auto"
    """Contrast thresholds: as the recording tells, or estimated per pixel; auto estimates them where it tells
    one value for all pixels."""
    refractory: Literal["auto", "known", "estimate"] = "auto"
    """Refractory period of the sensor: as the recording tells, or estimated; auto estimates it where the recording
    does not tell it."""
    lag: Literal["auto", "off"] = "auto"
    """Lag of the photoreceptors in dim light: estimated if the events show one, or left out."""
    priors: str = "normal,integrable,reflectance,spectra"
    """What pixels tell of each other, or none: smooth normals, slopes of one surface, smooth reflectance, spectra
    of few kinds. Edges stay, and the data decide how strong each is."""
    init: Literal["frontal", "geometry"] = "frontal"
    """Start value of the normals."""
    mask: Path | None = None
    """Image (PNG or .npy) whose non-zero pixels are solved."""
    seed: int = 0
    """Seed of everything random."""
    define: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-D"]), tyro.conf.UseAppendAction] = field(
        default=()
    )
    """name=value for a <default> parameter of the scene file; may be repeated."""
    device: Literal["cpu", "gpu"] = "cpu"
    """Where to compute; gpu needs an NVIDIA card."""


MOST_RAYS = {"fast": 4, "balanced": 16, "accurate": 64}  # per pixel, for visibility


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("fit", Options, command, argv)


def command(options: Options) -> None:
    """Fit, write the results, print a table."""
    out = options.out or options.events.with_name(options.events.stem)
    check_folder(out)
    maps, summary, surface = recover(options)
    write_results(out, maps, summary, surface)
    rows = [(f"{name} [s]", f"{seconds:.2f}") for name, seconds in summary["seconds"].items()]
    rows += [(name, f"{value:.4f}") for name, value in summary.get("error", {}).items()]
    print_table(f"{options.scene} {options.events}", rows)
    for effect, decision in summary["model"].items():
        print(f"{effect}: {decision}")
    print(f"pictures: {out / 'normal.png'}, {out / 'reflectance.png'}; all else in {out}")


def fit(options: Options) -> tuple[Maps, dict]:
    """Recover maps from a recording: `recover` without the surface."""
    return recover(options)[:2]


def recover(options: Options) -> tuple[Maps, dict, dict]:
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


def _fit(options: Options, stages: Stages) -> tuple[Maps, dict, dict]:
    check_range("--seed", options.seed, 0)
    priors = parse_priors(options.priors)
    with stages.stage("start"):
        from evsdr import jit

        jit.start("cuda_ad_spectral" if options.device == "gpu" else "llvm_ad_spectral")
        from evsdr import (
            decode,
            faults,
            fit_report,
            geometry_check,
            lag,
            light_choice,
            sensor_choice,
            transport,
        )
        from evsdr.gloss_search import solve_gloss
        from evsdr.problem import Observations
        from evsdr.scene import load_scene
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
        geometry_check.check_light(ring, traced, mask, options.scene)
        geometry_check.check_pieces(ring, asked, mask, options.scene)
        start_normal = decode.start_normals(ring, options.init)
    with stages.stage("pair events"):
        try:
            pairs = pair_events(recording, mask)
        except InputError as error:
            raise InputError(f"{options.events}: {error}") from error
    with stages.stage("check recording"):
        seen = Observations(recording, mask, pairs, faults.impossible_rate(recording, light))
        unknown, thresholds = sensor_choice.choose_thresholds(
            options.thresholds, options.solver, recording, ring
        )
        seen, refractory = sensor_choice.choose_refractory(options.refractory, seen, light, unknown)
    decoder = decode.Decoder(ring, options, priors, start_normal, unknown)
    late, lag_note = sensor_choice.looks_for_lag(options)
    found = None
    purpose = "alone" if late else "whole"
    with stages.stage("solve") as advance:
        fitted = decoder(seen.under(light), None, purpose, advance)
        fault = None
        if options.solver == "lm":
            fault = faults.find_fault(fitted.problem.pairs, fitted.problem.illumination, fitted.solution)
        if fault:
            fit_report.warn_of_fault(options.events, fault)
            seen = seen.in_order(fault.mend(seen.recording.schedule.order))
            fitted = decoder(seen.under(light), None, purpose, advance)
    if late:
        with stages.stage("lag, neighbours") as advance:
            known = seen.recording, fitted.problem, fitted.solution
            purpose, found = "learn", lag.find_lag(*known, unknown)
            if found:
                purpose, lag_note = "again", str(found)
                seen = seen.behind(lag.photoreceptors(*known, found))
            fitted = decoder(seen.under(light), fitted, purpose, advance)
    with stages.stage("settle light") as advance:

        def refit(light, fitted, quick):
            if quick or not found:
                return decoder(seen.under(light), fitted, "quick" if quick else "light", advance)
            receptors = lag.photoreceptors(seen.recording, fitted.problem, fitted.solution, found)
            return decoder(seen.behind(receptors).under(light), fitted, "light", advance)

        traced, fitted = transport.settle(ring, traced, asked, fitted, refit, advance)
    gloss = "angular gate, as published" if options.solver == "adam" else "not looked for by the preset fast"
    if options.solver == "lm" and (options.preset, options.gloss) != ("fast", "auto"):
        with stages.stage("gloss") as advance:
            view = decode.view_directions(ring, fitted.problem.pixel)
            effort = decode.choose_effort(options, priors)
            solution, gloss = solve_gloss(
                options.gloss, fitted.problem, fitted.solution, effort, view, advance
            )
            fitted = decoder.fitted(fitted.problem, solution)
    with stages.stage("surface"):
        surface = transport.surface_of(ring, fitted) if fitted.maps.mask.any() else {}
    geometry_check.check_normals(ring, traced, asked, fitted.maps, options.scene)
    fit_report.warn_of_what_was_found(options, ring, seen, fitted)
    notes = traced.notes | {
        "bands": fit_report.band_note(seen.recording, ring),
        "gloss": gloss,
        **fit_report.solver_notes(options.solver, priors, fitted.solution),
        "contrast thresholds": thresholds,
        "photoreceptor lag": lag_note,
        "scale": fit_report.scale_note(ring),
    }
    summary = fit_report.summarise(options, notes, seen, fitted, refractory)
    if truth is not None:
        summary["error"] = score(fitted.maps, truth)
        summary |= summary["error"]
    return fitted.maps, summary, surface


if __name__ == "__main__":
    sys.exit(main())
