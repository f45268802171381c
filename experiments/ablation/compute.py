"""Leave out each mechanism of the solver, and each prior, one at a time; or halve and double each of its numbers."""

import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from evsdr import (
    EventPixel,
    InputWarning,
    Recording,
    Schedule,
    Settings,
    Truth,
    fit,
    load_scene,
    score,
    simulate,
)
from evsdr.solve.tuning import Tuning

SCENES = Path(__file__).resolve().parents[2] / "scenes"
WITH_DARK = np.array([led for j in range(24) for led in ((-1, j) if j % 3 == 0 else (j,))], np.int32)


@dataclass(frozen=True)
class Case:
    """A kind of recording.

    Attributes
    ----------
    name, scene : str
        What it is called, and its file in `scenes/`.
    size : int
        Width and height [pixels].
    thresholds : str
        What the recording tells of them: `calibrated` or `nominal`.
    pixel : EventPixel
        By default that of an EVK4.
    order : (n_slot,) int32, optional
        LED of each slot; each in turn by default.
    """

    name: str
    scene: str
    size: int = 48
    thresholds: str = "calibrated"
    pixel: EventPixel = field(default_factory=EventPixel)
    order: np.ndarray | None = None


CASES = (
    Case("smooth sphere", "sphere"),
    Case("relief", "relief"),
    Case("texture", "blob"),
    Case("chart", "colorchecker", order=WITH_DARK),
    Case("thresholds as one value", "sphere_pole", thresholds="nominal"),
    Case("20 % event noise", "sphere", 48, "nominal", replace(EventPixel().idealised(), event_noise=0.2)),
)
ALL = Settings(gloss="off")  # a lobe found by chance would cost most of the time


def without_prior(name: str) -> Settings:
    """Leave one prior out."""
    return replace(ALL, priors=tuple(prior for prior in ALL.priors if prior != name))


def tuned(**numbers) -> Settings:
    """Change numbers of the solver."""
    return replace(ALL, tuning=replace(Tuning(), **numbers))


WAYS = {
    "all": ALL,
    "hard horizon from the start": tuned(softness=None),
    "no neighbours' starts": tuned(n_sweep=0),
    "one round of thresholds": tuned(n_spread=1),
    "cost not wider": tuned(wider=1.0),
    "no density of times": tuned(density=False),
    "no silence": tuned(silence=False),
    "no soft horizon in the end": tuned(curved=False),
    "misfits count": tuned(misfit=1e9),
    **{f"no prior: {name}": without_prior(name) for name in ALL.priors},
    "no priors": replace(ALL, priors=()),
}


def varied(factors=(0.5, 2.0)) -> dict[str, Settings]:
    """Multiply each number of the solver by factors, one at a time; whole numbers stay whole."""
    numbers = {field.name: getattr(Tuning(), field.name) for field in fields(Tuning)}
    ways = {
        f"{name} {type(value)(value * factor):g}": tuned(**{name: type(value)(value * factor)})
        for name, value in numbers.items()
        if type(value) in (int, float)
        for factor in factors
    }
    return {"all": ALL, **ways}


@dataclass(frozen=True)
class Result:
    """Errors of one fit: mean angle [deg], RMSE of reflectance; seconds."""

    mae_deg: float
    rmse: float
    seconds: float


def record(case: Case, seed: int) -> tuple[object, Recording, Truth]:
    """Give the loaded scene, a recording of it, and the truth."""
    scene = load_scene(SCENES / f"{case.scene}.xml", size=case.size)
    order = np.arange(scene.leds.n_led, dtype=np.int32) if case.order is None else case.order
    schedule = Schedule(order, 20_000.0, 1.0)
    recording, truth = simulate(scene, case.pixel, schedule, seed=seed, thresholds=case.thresholds)
    return scene, recording, truth


def run(case: Case, seeds: range, ways: dict[str, Settings] = WAYS) -> Iterator[tuple[str, int, Result]]:
    """Fit recordings of a case in each way; gives way, seed, and what came of it."""
    for seed in seeds:
        scene, recording, truth = record(case, seed)
        for way, settings in ways.items():
            start = time.perf_counter()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", InputWarning)
                found = fit(scene, recording, settings)
            errors = score(found.maps, truth)
            yield way, seed, Result(errors["mae_deg"], errors["rmse"], time.perf_counter() - start)
