"""`python -m evsdr.fit scene.xml events.h5`: recover normals and absolute reflectance from a recording."""

import sys
import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from evsdr import __version__
from evsdr.console import Stages, check_range, parse_definitions, print_table, run_command
from evsdr.errors import InputError, InputWarning
from evsdr.files import check_folder
from evsdr.mask import read_mask
from evsdr.metrics import read_truth, score
from evsdr.pairs import pair_events
from evsdr.recording import read_recording
from evsdr.records import Maps, Recording
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
WRONG_THRESHOLD = 0.1  # of its logarithm, from which a told threshold is worth a warning
CONTRARY = 50.0  # noise of a pixel, relative to most, whose events count for nothing
CONTRARY_SHARE, CONTRARY_COUNT = 0.01, 5  # of the pixels, from which they are worth a warning
PRIORS = ("normal", "integrable", "reflectance", "spectra")
MAX_BANDS = 40  # of the per-pixel systems
THRESHOLDS = (1e-3, 10.0)  # of natural log intensity, outside of which no event pixel is
MISFIT = 0.5  # relative threshold noise above which events and scene contradict each other


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
    parts = parse_priors(options.priors)
    with stages.stage("start"):
        from evsdr import jit

        jit.start("cuda_ad_spectral" if options.device == "gpu" else "llvm_ad_spectral")
        from evsdr import decode, faults, geometry_check, light_choice, transport
        from evsdr import scene as scenes
        from evsdr.gloss_search import solve_gloss
        from evsdr.lag import find_lag, without_lag
        from evsdr.problem import make_problem
    with stages.stage("read events"):
        recording = read_recording(options.events)
    with stages.stage("load scene"):
        ring = scenes.load_scene(options.scene, parse_definitions(options.define))
        check_fit(ring, recording, options)
        if ring.constant_light == 0:
            warnings.warn(
                InputWarning(
                    f"{options.scene}: constant_light is 0, so the scale of reflectance is unknown and the "
                    "largest band of each pixel is set to 1; measure the constant light and write it there."
                )
            )
        truth = None
        if options.truth:
            truth = read_truth(options.truth, ring.height, ring.width, ring.leds.n_band)
    with stages.stage("trace light"):
        asked = light_choice.Asked(
            options.shadows, options.leds, options.light_paths, MOST_RAYS[options.preset], options.seed + 1
        )
        traced = light_choice.first_light(ring, asked)
        light = traced.illumination
        mask = traced.coverage >= 0.5
        if not mask.any():
            raise InputError(f"{options.scene}: the camera does not see the shape object; move one of them.")
        if options.mask:
            mask &= read_mask(options.mask, mask.shape)
            if not mask.any():
                raise InputError(
                    f"{options.mask}: the mask has no pixel of the object; draw it over the object."
                )
        geometry_check.check_light(ring, traced, mask, options.scene)
        geometry_check.check_pieces(ring, asked, mask, options.scene)
        start_normal = decode.start_normals(ring, options.init)
    with stages.stage("pair events"):
        try:
            pairs = pair_events(recording, mask)
        except InputError as error:
            raise InputError(f"{options.events}: {error}") from error
        problem = make_problem(recording, pairs, light, mask)
    estimate, thresholds = decode.choose_thresholds(options.thresholds, options.solver, recording, ring)
    with stages.stage("check recording"):
        hot = faults.impossible_rate(recording, light)
        recording, refractory = decode.choose_refractory(options.refractory, recording, problem, estimate)
        if refractory["found_us"] is not None:
            pairs = pair_events(recording, mask)
        problem = make_problem(recording, pairs, light, mask, hot)
    late, lag = decode.looks_for_lag(options)
    purpose = "alone" if late else "whole"
    with stages.stage("solve") as advance:
        solution = decode.solve(problem, start_normal, options, parts, estimate, advance, None, purpose)
        fault = (
            faults.find_fault(problem.pairs, problem.illumination, solution)
            if options.solver == "lm"
            else None
        )
        if fault:
            warnings.warn(
                InputWarning(
                    f"{options.events}: {fault}, say the events, and the fit took that for true; "
                    "check the ring and schedule/order."
                )
            )
            order = fault.mend(recording.schedule.order)
            recording = replace(recording, schedule=replace(recording.schedule, order=order))
            problem = make_problem(recording, pairs, light, mask, hot)
            solution = decode.solve(problem, start_normal, options, parts, estimate, advance, None, purpose)
        maps = decode.assemble_maps(problem, solution, mask.shape, ring)
    if late:
        with stages.stage("lag, neighbours") as advance:
            before, purpose = (maps, solution), "learn"
            found = find_lag(recording, problem, solution, estimate)
            if found:
                lag = "events are {:.3g} +- {:.2g} us / I late, as they say, and were moved back".format(
                    *found
                )
                recording = without_lag(recording, problem, solution, found[0])
                pairs = pair_events(recording, mask)
                problem, purpose = make_problem(recording, pairs, light, mask, hot), "again"
            solution = decode.solve(problem, start_normal, options, parts, estimate, advance, before, purpose)
            maps = decode.assemble_maps(problem, solution, mask.shape, ring)
    with stages.stage("settle light") as advance:

        def refit(light, fitted, quick):
            problem = make_problem(recording, pairs, light, mask, hot)
            before, purpose = (fitted.maps, fitted.solution), "quick" if quick else "light"
            solution = decode.solve(problem, start_normal, options, parts, estimate, advance, before, purpose)
            return transport.Fitted(
                problem, solution, decode.assemble_maps(problem, solution, mask.shape, ring)
            )

        traced, fitted = transport.settle(
            ring, traced, asked, transport.Fitted(problem, solution, maps), refit, advance
        )
        problem, solution, maps = fitted.problem, fitted.solution, fitted.maps
    gloss = "angular gate, as published" if options.solver == "adam" else "not looked for by the preset fast"
    if options.solver == "lm" and (options.preset, options.gloss) != ("fast", "auto"):
        with stages.stage("gloss") as advance:
            view = decode.view_directions(ring, problem.pixel)
            effort = decode.choose_effort(options, parts)
            solution, gloss = solve_gloss(options.gloss, problem, solution, effort, view, advance)
            maps = decode.assemble_maps(problem, solution, mask.shape, ring)
            fitted = transport.Fitted(problem, solution, maps)
    geometry_check.check_normals(ring, traced, asked, maps, options.scene)
    if solution.noise <= MISFIT:
        warn_of_hot_pixels(options.events, pairs, problem, solution, hot)
    if not maps.mask.any():
        warnings.warn(
            InputWarning(
                f"{options.events}: no pixel is known; record more rounds, or with less constant light."
            )
        )
    if solution.noise > MISFIT:
        warnings.warn(
            InputWarning(
                f"{options.events}: the events contradict {options.scene}, their thresholds scatter by "
                f"{solution.noise:.0%}; check order, slot_us, triggers, thresholds and constant_light."
            )
        )
    sensor = decode.sensor_summary(recording, solution, maps.mask.ravel()[problem.pixel])
    for name, values in sensor.items():
        if solution.noise < MISFIT and abs(np.log(values["found"] / values["told"])) > WRONG_THRESHOLD:
            warnings.warn(
                InputWarning(
                    f"{options.events}: {name} is told as {values['told']:.3g} but the events say "
                    f"{values['found']:.3g}; the latter was used: "
                    "check the camera's biases, or the surface is not matt."
                )
            )
    summary = {
        "evsdr": __version__,
        "scene": str(options.scene),
        "events": str(options.events),
        "solver": options.solver,
        "preset": options.preset,
        "model": {
            **traced.notes,
            "bands": decode.band_note(recording, ring),
            "gloss": gloss,
            "silence": "used: between events log I stays within the thresholds"
            if options.solver == "lm"
            else "not used: the solver adam looks at events only",
            "event times": "their density counts, with its slope term"
            if options.solver == "lm"
            else "not used",
            "neighbours": prior_note(parts, solution) if options.solver == "lm" else "blurred, as published",
            "contrast thresholds": thresholds,
            "photoreceptor lag": lag,
            "scale": decode.scale_note(ring),
        },
        "numbers": {
            "events": pairs.n_event,
            "pairs": int(pairs.offset[-1]),
            "pairs_dropped": pairs.n_dropped,
            "pixels_solved": problem.n_pixel,
            "pixels_known": int(np.count_nonzero(maps.mask)),
            "steps": solution.n_step,
        },
        "sensor": sensor | {"refractory_us": refractory},
        "residual": {"relative_threshold_noise": solution.noise},
    }
    if truth is not None:
        summary["error"] = score(maps, truth)
        summary |= summary["error"]
    with stages.stage("surface"):
        surface = transport.surface_of(ring, fitted) if maps.mask.any() else {}
    return maps, summary, surface


def warn_of_hot_pixels(path: Path, pairs, problem, solution, hot: np.ndarray) -> None:
    """Say how many pixels fire events that the light does not explain."""
    contrary = hot.ravel()[problem.pixel] | (solution.noise_factor > CONTRARY)
    if np.count_nonzero(contrary) < max(CONTRARY_COUNT, CONTRARY_SHARE * len(contrary)):
        return
    count = np.diff(pairs.offset.astype(np.int64))[problem.pixel]
    often = np.median(count[contrary]) > 2 * np.median(count[~contrary]) if not contrary.all() else False
    cause = (
        "they fire more often than the others, so they are probably hot: mask them in the camera"
        if often
        else "gloss, a shadow that is not modelled, or other light may be the cause"
    )
    warnings.warn(
        InputWarning(
            f"{path}: {contrary.mean():.0%} of the pixels fire events that the light of the ring does not explain; "
            f"{cause}. Their values come from their neighbours."
        )
    )


def parse_priors(text: str) -> tuple[str, ...]:
    """Read the names of priors."""
    names = tuple(name.strip() for name in text.split(",")) if text != "none" else ()
    for name in names:
        if name not in PRIORS:
            raise InputError(
                f"--priors {text}: there is no {name!r}; name some of {', '.join(PRIORS)}, or none."
            )
    return names


def prior_note(parts: tuple[str, ...], solution) -> str:
    """Say which priors count, and how strong the data make them."""
    if not parts:
        return "each pixel alone: asked for by --priors none"
    what = {
        "normal": "normals bend by {:.2g} per pixel squared",
        "integrable": "slopes around four pixels add up to {:.2g}",
        "reflectance": "log reflectances bend by {:.2g}",
        "rank": "spectra vary visibly in {} directions",
    }
    found = [what[name].format(value) for name, value in solution.prior_scale.items()]
    return "; ".join(found) or "too few pixels to learn from"


def check_fit(ring, recording: Recording, options: Options) -> None:
    """Check that scene and recording belong together."""
    size = (recording.sensor.width, recording.sensor.height)
    if size != (ring.width, ring.height):
        raise InputError(
            f"{options.scene}: the film is {ring.width} x {ring.height} pixels but the events of {options.events} "
            f"are {size[0]} x {size[1]}; make the film as large as the sensor region."
        )
    for name in ("contrast_threshold_on", "contrast_threshold_off"):
        threshold = np.asarray(getattr(recording.sensor, name))
        if threshold.min() < THRESHOLDS[0] or threshold.max() > THRESHOLDS[1]:
            raise InputError(
                f"{options.events}: {name} goes from {threshold.min():g} to {threshold.max():g}; "
                "write changes of natural log intensity, as 0.25."
            )
    unknown = int(np.max(recording.schedule.order))
    if unknown >= ring.leds.n_led:
        raise InputError(
            f"{options.events}: schedule/order lights LED {unknown}, but {options.scene} has only "
            f"{ring.leds.n_led} LEDs, numbered from 0; mend order or add the emitter."
        )
    if options.solver == "lm" and ring.leds.n_band > MAX_BANDS:
        raise InputError(
            f"{options.scene}: {ring.leds.n_band} bands are too many for the solver lm, which takes {MAX_BANDS}; "
            "use --solver adam."
        )


if __name__ == "__main__":
    sys.exit(main())
