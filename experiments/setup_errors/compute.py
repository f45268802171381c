"""Recordings whose set-up is told wrong, fitted as told and with `repair`; and such that are told right."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from evsdr import (
    EventPixel,
    InputError,
    InputWarning,
    Recording,
    Schedule,
    Settings,
    fit,
    load_scene,
    score,
    simulate,
)

SCENES = {  # recorded, and told to the fit
    "sphere": ("sphere", "sphere"),
    "blob": ("blob", "blob"),
    "relief, unknown shape": ("relief", "relief_unknown"),
}
ALL = "sphere sphere_pole blob relief two_spheres colorchecker near_ring glossy_sphere soft_ring".split()
ALL = {name: (name, name) for name in ALL} | {"relief, unknown shape": ("relief", "relief_unknown")}
SLOT_US = 20_000.0
SCENE_FILES = Path(__file__).resolve().parents[2] / "scenes"


@dataclass(frozen=True)
class Wrong:
    """One error.

    Attributes
    ----------
    what : str
    words : str
        What must be said.
    change : callable (Recording) -> Recording
    constant_light : str
        As the scene tells it to the fit.
    known : bool
        Whether the fit takes thresholds as told.
    crossfade : float
        As it was recorded; told as 1 unless `change` tells another.
    """

    what: str
    words: str
    change: Callable[[Recording], Recording] = lambda recording: recording
    constant_light: str = "0.05"
    known: bool = False
    crossfade: float = 1.0


def moved(recording: Recording, move: Callable) -> Recording:
    """Move events in the image."""
    events, last = recording.events, recording.sensor.width - 1
    x, y = (v.astype(np.uint16) for v in move(events.x.astype(int), events.y.astype(int), last))
    return replace(recording, events=replace(events, x=x, y=y))


def reordered(recording: Recording, change: Callable) -> Recording:
    """Tell another order of the LEDs."""
    order = change(recording.schedule.order)
    return replace(recording, schedule=replace(recording.schedule, order=order))


def swapped(order: np.ndarray) -> np.ndarray:
    """Swap LEDs 3 and 10."""
    return np.select([order == 3, order == 10], [10, 3], order).astype(order.dtype)


def scheduled(recording: Recording, slots: float = 1.0, crossfade: float = 1.0) -> Recording:
    """Tell slots that are so many times as long, and another crossfade."""
    schedule = recording.schedule
    schedule = replace(schedule, slot_us=slots * schedule.slot_us, crossfade=crossfade)
    return replace(recording, schedule=schedule)


def flipped(recording: Recording) -> Recording:
    """Swap polarities."""
    events = recording.events
    return replace(recording, events=replace(events, p=(1 - events.p).astype(events.p.dtype)))


def in_unit(recording: Recording, us: float) -> Recording:
    """Tell times in a unit of so many us."""
    events = replace(recording.events, t=(recording.events.t / us).astype(np.int64))
    return replace(recording, events=events, round_start_us=(recording.round_start_us / us).astype(np.int64))


def sensed(recording: Recording, threshold: float = 1.0, refractory: float = 1.0) -> Recording:
    """Tell thresholds and the refractory period so many times too large."""
    sensor = recording.sensor
    sensor = replace(
        sensor,
        contrast_threshold_on=threshold * sensor.contrast_threshold_on,
        contrast_threshold_off=threshold * sensor.contrast_threshold_off,
        refractory_us=refractory * sensor.refractory_us,
    )
    return replace(recording, sensor=sensor)


WRONG = (
    Wrong("image mirrored in x", "mirrored in x", partial(moved, move=lambda x, y, m: (m - x, y))),
    Wrong("image mirrored in y", "mirrored in y", partial(moved, move=lambda x, y, m: (x, m - y))),
    Wrong("image turned by 90", "by 90 degrees counter", partial(moved, move=lambda x, y, m: (y, m - x))),
    Wrong("image turned by 180", "by 180 degrees", partial(moved, move=lambda x, y, m: (m - x, m - y))),
    Wrong("image turned by 270", "by 90 degrees clock", partial(moved, move=lambda x, y, m: (m - y, x))),
    Wrong("x and y swapped", "are swapped", partial(moved, move=lambda x, y, m: (y, x))),
    Wrong("order reversed", "is reversed", partial(reordered, change=lambda o: o[::-1])),
    Wrong("order rolled by 1", "is rolled", partial(reordered, change=lambda o: np.roll(o, 1))),
    Wrong("order rolled by 8", "is rolled", partial(reordered, change=lambda o: np.roll(o, 8))),
    Wrong("two LEDs swapped", "LEDs 3 and 10", partial(reordered, change=swapped)),
    Wrong("polarities flipped", "polarities", flipped),
    Wrong("crossfade told 0 for 1", "fade into", partial(scheduled, crossfade=0.0)),
    Wrong("crossfade told 0 for 0.1", "fade within 0.", partial(scheduled, crossfade=0.0), crossfade=0.1),
    Wrong("crossfade told 1 for 0", "switch without", crossfade=0.0),
    Wrong("crossfade told 1 for 0.3", "fade within 0.", crossfade=0.3),
    Wrong("crossfade told 1 for 0.8", "fade within 0.", crossfade=0.8),
    Wrong("slots told 10 times too long", "slots last 0.1", partial(scheduled, slots=10.0)),
    Wrong("slots told 10 times too short", "slots last 10", partial(scheduled, slots=0.1)),
    Wrong("times in ns", "in ns", partial(in_unit, us=1e-3)),
    Wrong("times in ms", "in ms", partial(in_unit, us=1e3)),
    Wrong("refractory period 10 times", "refractory_us is told", partial(sensed, refractory=10.0)),
    Wrong("thresholds double, known", "thresholds", partial(sensed, threshold=2.0), known=True),
    Wrong("thresholds half, known", "thresholds", partial(sensed, threshold=0.5), known=True),
    Wrong("constant light told 0", "there is constant light", constant_light="0"),
    Wrong("constant light told 10 times", "10 times too large", constant_light="0.5"),
)


@dataclass(frozen=True)
class Row:
    """What came of one error.

    Attributes
    ----------
    right, before, after : float
        Mean angle [deg] where all is told right, as told, and with `repair`.
    verdict : str
        As told.
    found : bool
        Whether it says the words.
    """

    right: float
    before: float
    after: float
    verdict: str
    found: bool


@cache
def recorded(scene: str, size: int, seed: int, crossfade: float = 1.0):
    """Record a scene by an EVK4; gives the recording, with thresholds as one value and of each pixel, and the truth."""
    ring = load_scene(SCENE_FILES / f"{scene}.xml", size=size)
    pixel = EventPixel()
    schedule = Schedule(np.arange(ring.leds.n_led, dtype=np.int32), SLOT_US, crossfade)
    recording, truth = simulate(ring, pixel, schedule, seed=seed)
    on, off = pixel.contrast_threshold_on, pixel.contrast_threshold_off
    sensor = replace(recording.sensor, contrast_threshold_on=on, contrast_threshold_off=off)
    return replace(recording, sensor=sensor), recording, truth


def fitted(scene: str, recording: Recording, truth, size: int, constant_light: str = "0.05", **settings):
    """Fit; gives the mean angle [deg] and the verdict, or what is refused."""
    ring = load_scene(SCENE_FILES / f"{scene}.xml", size=size, constant_light=constant_light)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        try:
            found = fit(ring, recording, Settings(**settings))
        except InputError as error:
            return np.nan, f"refused: {error}"
    return score(found.maps, truth)["mae_deg"], found.verdict


@cache
def told_right(names: tuple[str, str], size: int, seed: int, known: bool, preset: str) -> float:
    """Give the mean angle [deg] where all is told right."""
    recording, _, truth = recorded(names[0], size, seed)
    thresholds = "known" if known else "auto"
    return fitted(names[1], recording, truth, size, thresholds=thresholds, preset=preset)[0]


def run(wrong: Wrong, names: tuple[str, str], size: int, seed: int, preset: str) -> Row:
    """Tell one error, and fit as told and with `repair`."""
    recording, _, truth = recorded(names[0], size, seed, wrong.crossfade)
    recording = scheduled(recording)
    thresholds = "known" if wrong.known else "auto"
    given = names[1], wrong.change(recording), truth, size, wrong.constant_light
    before, verdict = fitted(*given, thresholds=thresholds, preset=preset)
    after, _ = fitted(*given, thresholds=thresholds, preset=preset, repair=True)
    right = told_right(names, size, seed, wrong.known, preset)
    return Row(right, before, after, verdict, wrong.words in verdict)


def alarm(
    names: tuple[str, str], size: int, seed: int, crossfade: float, one_value: bool, preset: str
) -> str:
    """Give the verdict on a recording that is told right."""
    single, each, truth = recorded(names[0], size, seed, crossfade)
    return fitted(names[1], single if one_value else each, truth, size, preset=preset)[1]
