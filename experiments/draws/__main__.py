"""`python -m experiments.draws`: fit recordings of scenes, rings and sensors drawn at random; errors beyond sigma."""

import argparse
import ast
import sys
import time
import warnings
from dataclasses import replace

import numpy as np

import evsdr
from evsdr.fitting.simulation import render
from tests.support.foreign_pixel import watch
from tests.support.foreign_recordings import ESIM, EVENTPS, EVK4_LIKE, IEBCS, V2E, as_recording

from ..sigma.compute import Errors, errors_of
from ..sigma.statistics import keeps_promise, shares_within
from .cases import Draw, draw, open_text, scene_text

FOREIGN = {"iebcs": IEBCS, "v2e": V2E, "eventps": EVENTPS, "esim": ESIM}
SPREAD = 0.2, 0.1  # of thresholds over the pixels, relative
# Frames of a fade, at least (guessed), where a simulator's light is linear in log I from frame to frame: frames 500 us apart under fades of 7 ms
# have steps of four thresholds, and turn the time of every event into that of another light. See README, 1043
FRAMES = 100
COLUMNS = "draw | normals: known, mean deg, % within 1 2 3 | R: % within 1 2 3 | promise | s | verdict"


def main(argv: list[str] | None = None) -> int:
    """Record and fit each draw; print a line of each, and at the end how many keep the promise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seeds", type=int, nargs=2, default=(0, 40), help="the first draw, and the one after the last"
    )
    parser.add_argument("--size", type=int, default=40, help="width and height [pixels]")
    parser.add_argument("--no-mask", action="store_true", help="do not tell which pixels are the object")
    parser.add_argument(
        "--but",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="what is otherwise than drawn: shape=sphere pauses=True",
    )
    options = parser.parse_args(argv)
    try:
        otherwise(draw(0), options.but)
    except ValueError as error:
        parser.error(f"--but: {error}")
    print(f"| {COLUMNS} |\n|{'---|' * 6}")
    kept = []
    for seed in range(*options.seeds):
        case = otherwise(draw(seed), options.but)
        begin = time.perf_counter()
        errors = run(case, options.size, masked=not options.no_mask)
        kept.append([keeps_promise(within(z)) for z in (errors.angle, np.abs(errors.reflectance).ravel())])
        print(line(case, errors, kept[-1], time.perf_counter() - begin), flush=True)
    normals, reflectances = np.sum(kept, axis=0)
    print(
        f"\nthe promise (60, 90, 97 %) holds for {normals} (normals), {reflectances} (R) of {len(kept)} draws"
    )
    return 0


def otherwise(case: Draw, changes: list[str]) -> Draw:
    """Change parts of a draw, each NAME=VALUE of `cases.Draw`; a ValueError names what is no such change."""
    new = {}
    for change in changes:
        name, _, value = change.partition("=")
        kind = type(getattr(case, name, None))
        try:
            new[name] = value if kind is str else ast.literal_eval(value)
            known = (
                value
                and name in vars(case)
                and isinstance(new[name], (int, float) if kind is float else kind)
            )
        except (ValueError, SyntaxError):
            known = False
        if not known:
            raise ValueError(f"{change!r} is no NAME=VALUE with a name of {', '.join(vars(case))}.")
    return replace(case, **new)


def within(z: np.ndarray) -> np.ndarray:
    """Give the shares (3,) within one, two, three sigma; all, where nothing is known."""
    return shares_within(z) if len(z) else np.ones(3)


def line(case: Draw, errors: Errors, kept: list[bool], seconds: float) -> str:
    """Write a row of the table."""

    def percent(z):
        return " ".join(f"{100 * share:.0f}" for share in within(z))

    cells = [
        f"{case.seed}: {case}",
        f"{errors.known:.0%}, {errors.mean_deg:.2f}, {percent(errors.angle)}",
        percent(np.abs(errors.reflectance).ravel()),
        " ".join("yes" if k else "no" for k in kept),
        f"{seconds:.0f}",
        errors.verdict[:100],
    ]
    return f"| {' | '.join(cells)} |"


def run(case: Draw, size: int, settings: evsdr.Settings = evsdr.Settings(), masked: bool = True) -> Errors:
    """Record and fit a draw, `masked`: with its pixels told."""
    told, recording, truth = record(case, size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", evsdr.InputWarning)  # not all is told as it is
        found = evsdr.fit(told, recording, settings, truth.mask if masked else None)
    return errors_of(found.maps, truth, case.seed, found.summary["verdict"])


def record(case: Draw, size: int):
    """Give the scene as it is told, a recording, and the truth."""
    pixel = foreign_pixel(case)
    true, told = (
        open_text(scene_text(case, told, pixel.dark_light if pixel else 0.0), size) for told in (False, True)
    )
    schedule = evsdr.Schedule(case.order, case.slot_us, case.crossfade)
    if pixel is None:
        own = evsdr.EventPixel(
            case.on,
            case.off,
            SPREAD[0] * case.on,
            SPREAD[1] * case.off,
            event_noise=case.event_noise,
            refractory_us=case.refractory_us,
        )
        recording, truth = evsdr.simulate(true, own, schedule, case.rounds, case.seed, "nominal")
        rest_us = case.refractory_us
    else:
        signal, truth = render(true)
        ring = case.order, case.slot_us, case.crossfade, case.rounds
        events = watch(signal, case.constant_light, *ring, pixel, case.seed)
        rest_us = 0.0 if pixel.steps else pixel.refractory_us
        recording = as_recording(events, evsdr.Sensor(size, size, pixel.on, pixel.off, rest_us), schedule)
    names = "contrast_threshold_on", "contrast_threshold_off"
    wrong = {name: case.told_threshold * getattr(recording.sensor, name) for name in names}
    sensor = replace(recording.sensor, **wrong, refractory_us=case.told_refractory * rest_us)
    return told, replace(recording, sensor=sensor), truth


def foreign_pixel(case: Draw):
    """Give the event pixel by other hands' physics; None for ours."""
    if case.pixel == "evk4_like":
        return EVK4_LIKE._replace(
            on=case.on,
            off=case.off,
            mismatch_on=SPREAD[0] * case.on,
            mismatch_off=SPREAD[1] * case.off,
            event_noise=case.event_noise,
            refractory_us=case.refractory_us,
        )
    pixel = FOREIGN.get(case.pixel)
    if pixel is None or not pixel.frame_us:
        return pixel
    fade_us = (case.crossfade or 1) * case.slot_us
    return pixel._replace(frame_us=min(pixel.frame_us, fade_us / FRAMES))


if __name__ == "__main__":
    sys.exit(main())
