"""What each method recovers from a recording, and how far that is from the truth."""

import json
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import evsdr
from evsdr import InputWarning, Settings, Truth

from .cases import BAND_NM, REFRACTORY_US, THRESHOLD, Case, led_directions
from .frames import solve_multiplexed, solve_one_chromaticity, solve_reciprocal, training_spectra
from .recordings import BYTES_PER_EVENT, CONSTANT_LIGHT, SHOT_BYTES, SHOT_LEDS, read_events
from .two_stage import solve_stages

FULL_SIZE = 256  # pixels of the paper's volumes
STAGES = "normal", "spectrum"


def read_case(folder: Path) -> tuple[Case, Truth]:
    """Read what a folder holds, and what is true of it."""
    case = Case(**json.loads((folder / "case.json").read_text()))
    with np.load(folder / "truth.npz") as data:
        return case, Truth(**data)


def run(method: str, folder: Path) -> dict[str, float]:
    """Apply a method to a recording.

    Returns
    -------
    dict
        `mae_deg`, `sam_deg`, `rmse`, and that with the one factor that suits the scene best, `scaled_rmse`; `mib`,
        what the method was given, as of 256 x 256 pixels; CPU `seconds` of all cores.
    """
    case, truth = read_case(folder)
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        found, n_byte, note = METHODS[method](folder, case, truth)
    seconds = time.process_time() - begin
    error = evsdr.score(found, truth)
    mib = n_byte * FULL_SIZE**2 / truth.mask.size / 2**20
    return (
        {name: error[name] for name in ("mae_deg", "sam_deg", "rmse")}
        | {"scaled_rmse": evsdr.score(scaled(found.normal, found.reflectance, truth), truth)["rmse"]}
        | {"mib": mib, "seconds": seconds}
        | note
    )


def fit(settings: Settings, folder: Path, case: Case, truth: Truth) -> tuple:
    """Fit the events of the ring: maps, bytes, and what the fit says of itself."""
    recording = evsdr.read_recording(folder / "events.h5")
    found = evsdr.fit(evsdr.load_scene(folder / "scene.xml"), recording, settings, truth.mask)
    note = {"verdict": found.verdict, "gloss": found.summary["model"]["gloss"]}
    return found.maps, BYTES_PER_EVENT * len(recording.events), note


def fit_stages(folder: Path, case: Case, truth: Truth) -> tuple:
    """Solve for normals, then for spectra, each from events of its own."""
    stages = {stage: read_events(folder, stage) for stage in STAGES}
    sensor = THRESHOLD * case.told, REFRACTORY_US, CONSTANT_LIGHT
    normal, reflectance = solve_stages(stages, led_directions(case.polar_deg), *sensor, truth.mask.shape)
    n_event = sum(len(events) for events, _, _ in stages.values())
    return scaled(normal, reflectance, truth), BYTES_PER_EVENT * n_event, {}


def fit_frames(solve: Callable, folder: Path, case: Case, truth: Truth) -> tuple:
    """Solve a shot of all bands."""
    by_band = np.argsort(SHOT_LEDS % len(BAND_NM))
    with np.load(folder / "frames.npz") as data:
        image = data["image"][by_band][:, truth.mask].T.astype(float)
    light = led_directions(case.polar_deg)[SHOT_LEDS[by_band]]
    normal, reflectance = np.zeros_like(truth.normal), np.zeros_like(truth.reflectance)
    normal[truth.mask], reflectance[truth.mask] = solve(case, image, light)
    return scaled(normal, reflectance, truth), SHOT_BYTES * truth.mask.size, {}


def multiplexed(case: Case, image: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve as Fyffe et al."""
    return solve_multiplexed(image, light, training_spectra())


def varying(case: Case, image: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve as Guo et al., who are told whether the object has one chromaticity."""
    if case.bases == 1:
        return solve_one_chromaticity(image, light)
    return solve_reciprocal(image, light, training_spectra())


def scaled(normal: np.ndarray, reflectance: np.ndarray, truth: Truth) -> Truth:
    """Scale reflectances that are not absolute by one factor, that of least squares."""
    found, true = reflectance[truth.mask], truth.reflectance[truth.mask]
    return Truth(normal, reflectance * (found * true).sum() / max((found**2).sum(), 1e-30), truth.mask)


METHODS = {
    "ours, balanced": partial(fit, Settings()),
    "ours, fast": partial(fit, Settings(preset="fast")),
    "ours, thresholds taken as told": partial(fit, Settings(thresholds="known")),
    "EventSpecPS, its decoder": partial(fit, Settings(solver="adam")),
    "two stages": fit_stages,
    "frames, Guo et al.": partial(fit_frames, varying),
    "frames, Fyffe et al.": partial(fit_frames, multiplexed),
}
