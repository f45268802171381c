"""Fit recordings whose rig is told wrong, or not told: with what pixels share taken as told, inferred, and true."""

import cProfile
import pstats
import time
import warnings
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np

from evsdr import (
    EventPixel,
    Fit,
    InputWarning,
    Recording,
    Schedule,
    Settings,
    Truth,
    angular_error_deg,
    fit,
    load_scene,
    score,
    simulate,
)
from evsdr.solve.shared.rig import across

SCENES = Path(__file__).resolve().parents[2] / "scenes"
DEFAULT = Settings(gloss="off")  # a lobe found by chance would cost most of the time
NONE = replace(DEFAULT, shared=())
TOLD = replace(DEFAULT, shared=("lag", "leak"))  # no file tells these: inferred alone is the closest
LEVELS = np.arange(1, 4)[:, None]  # standard deviations
NAMES = ("tau", "noise", "shift", "refractory", "leak", "C_on", "C_off", "powers", "directions")


@dataclass(frozen=True)
class Watched:
    """What is recorded.

    Attributes
    ----------
    slot_us : float
    rounds : int
    white : bool
        Whether all LEDs have one spectrum.
    crossfade : float
    pixel : EventPixel
        By default that of an EVK4.
    """

    slot_us: float = 20_000.0
    rounds: int = 6
    white: bool = False
    crossfade: float = 1.0
    pixel: EventPixel = field(default_factory=EventPixel)


@dataclass(frozen=True)
class Wrong:
    """How wrong the rig is told.

    Attributes
    ----------
    power : float
        Standard deviation of the logarithm of each LED's power, within its band.
    tilt_deg : float
        Of its direction, each way [deg].
    late_us : float
        By which all events are late [us].
    refractory, on, off : float
        Factors of the period and the thresholds that are told.
    """

    power: float = 0.0
    tilt_deg: float = 0.0
    late_us: int = 0
    refractory: float = 1.0
    on: float = 1.0
    off: float = 1.0


@dataclass(frozen=True)
class Case:
    """A row of the table."""

    name: str
    watched: Watched = Watched()
    wrong: Wrong = Wrong()


ALL_WRONG = Wrong(0.1, 1.0, 50, 1.15, 1.15, 0.85)
WHITE = Watched(50_000.0, 4, white=True)
CASES = (
    Case("slots of 20 ms"),
    Case("slots of 10 ms", Watched(10_000.0)),
    Case("slots of 5 ms", Watched(5_000.0)),
    Case("slots of 2 ms", Watched(2_000.0)),
    Case("slots of 200 ms", Watched(200_000.0, 2)),
    Case("LEDs that switch", Watched(crossfade=0.0)),
    Case("white LED, 1.2 s a round", WHITE),
    Case("white LED, noise 0.03", replace(WHITE, pixel=EventPixel(photon_rate_per_us=10.0))),
    Case("powers 10 % off", wrong=Wrong(power=ALL_WRONG.power)),
    Case("directions 1 degree off", wrong=Wrong(tilt_deg=ALL_WRONG.tilt_deg)),
    Case("times 50 us late", wrong=Wrong(late_us=ALL_WRONG.late_us)),
    Case("refractory 15 % wrong", wrong=Wrong(refractory=ALL_WRONG.refractory)),
    Case("thresholds 15 % wrong", wrong=Wrong(on=ALL_WRONG.on, off=ALL_WRONG.off)),
    Case("all of these wrong", wrong=ALL_WRONG),
    Case("20 % event noise", Watched(pixel=EventPixel(event_noise=0.2))),
)


@dataclass(frozen=True)
class Rig:
    """What is true of the LEDs, against what the fitted scene tells.

    Attributes
    ----------
    scene : RingScene
        As it is told.
    log_power : (n_led,) float
    tilt_deg : (n_led, 2) float
        Along the axes of `evsdr.solve.shared.rig.across`.
    """

    scene: object
    log_power: np.ndarray
    tilt_deg: np.ndarray


@dataclass(frozen=True)
class Errors:
    """Of one fit.

    Attributes
    ----------
    mae_deg, known_deg, mapped_deg : float
        Mean angle [deg]: of all pixels, of those that the fit calls known, and of these up to the linear map of the
        normals that fits best.
    rmse : float
        Of the reflectance.
    within, reflectance_within : (3,) float
        Shares of the known pixels within 1, 2, 3 sigma.
    seconds, share : float
        CPU seconds of all cores, and the share of the inference.
    """

    mae_deg: float
    known_deg: float
    mapped_deg: float
    rmse: float
    within: np.ndarray
    reflectance_within: np.ndarray
    seconds: float
    share: float


@dataclass(frozen=True)
class Result:
    """Of one recording.

    Attributes
    ----------
    none, default, told, one_value : Errors
        With what pixels share as told, inferred, and told true: with thresholds of each pixel, or as one value.
    found : dict of (value, truth, z)
        For each of `NAMES` what was inferred, what is true, and the difference in units of sigma; for powers and
        directions, root mean squares over the LEDs: of the difference left, of that there was, and of its z.
    n_step : int
        Of the last inference.
    """

    none: Errors
    default: Errors
    told: Errors
    one_value: Errors
    found: dict
    n_step: int


def run(case: Case, scene: str, size: int, seed: int) -> Result:
    """Record a case and fit it in four ways."""
    recording, pixelwise, truth = record(case.watched, scene, size, seed)
    rig = told_rig(case, scene, size, seed)
    given = told_wrong(recording, case.wrong)
    none, _ = fitted(rig.scene, given, truth, NONE)
    default, found = fitted(rig.scene, given, truth, replace(DEFAULT, leds_told_to=case.wrong.tilt_deg))
    told, one_value = told_true(case.watched, scene, size, seed)
    compared, n_step = against_truth(found, case, rig, given, pixelwise, truth)
    return Result(none, default, told, one_value, compared, n_step)


@cache
def record(watched: Watched, scene: str, size: int, seed: int) -> tuple[Recording, Recording, Truth]:
    """Give a recording that tells thresholds as one value, the same with those of each pixel, and the truth."""
    ring = opened(scene, size, watched.white)
    schedule = Schedule(np.arange(ring.leds.n_led, dtype=np.int32), watched.slot_us, watched.crossfade)
    recording, truth = simulate(ring, watched.pixel, schedule, watched.rounds, seed)
    one_value = replace(
        recording.sensor,
        contrast_threshold_on=watched.pixel.contrast_threshold_on,
        contrast_threshold_off=watched.pixel.contrast_threshold_off,
    )
    return replace(recording, sensor=one_value), recording, truth


@cache
def told_true(watched: Watched, scene: str, size: int, seed: int) -> tuple[Errors, Errors]:
    """Fit with everything told true, and with all but the thresholds of each pixel."""
    one_value, pixelwise, truth = record(watched, scene, size, seed)
    ring = opened(scene, size, watched.white)
    return tuple(fitted(ring, recording, truth, TOLD)[0] for recording in (pixelwise, one_value))


@cache
def opened(scene: str, size: int, white: bool):
    """Load a scene as it is."""
    return altered(scene, size, white, lambda j, values: values, lambda j, direction: direction)


def told_rig(case: Case, scene: str, size: int, seed: int) -> Rig:
    """Load a scene that tells powers and directions wrong, and say what is true against that."""
    n_led, rng = 24, np.random.default_rng(seed)
    band = opened(scene, size, case.watched.white).leds.band
    log_factor, turn = case.wrong.power * rng.normal(size=n_led), rng.normal(size=(n_led, 2))
    log_factor -= (np.bincount(band, log_factor) / np.bincount(band))[
        band
    ]  # no recording tells a band's gain
    tilt = np.zeros((n_led, 2))

    def tell(j: int, direction: np.ndarray) -> np.ndarray:
        told = direction + np.radians(case.wrong.tilt_deg) * turn[j] @ across(direction)
        told /= np.linalg.norm(told)
        tilt[j] = across(told) @ direction / (told @ direction)
        return told

    loaded = altered(scene, size, case.watched.white, lambda j, values: np.exp(log_factor[j]) * values, tell)
    return Rig(loaded, -log_factor, np.degrees(tilt))


def altered(
    scene: str,
    size: int,
    white: bool,
    power: Callable,
    turn: Callable,
    files: dict[str, str] | None = None,
    **define,
):
    """Load a scene whose LEDs have other spectra (n,), `power(j, spectrum)`, and directions (3,), `turn(j, direction)`.

    It is one of `scenes/` or of other `files`, texts by their names; `define` gives values of its parameters.
    """
    with TemporaryDirectory() as folder:
        copytree(SCENES, folder, dirs_exist_ok=True)
        for name, text in (files or {}).items():
            (Path(folder) / name).write_text(text)
        path = Path(folder) / "ring24.xml"
        tree = ElementTree.parse(path)
        spectra = {spectrum.get("id"): spectrum for spectrum in tree.iter("spectrum")}
        for j, emitter in enumerate(list(tree.iter("emitter"))):
            vector, reference = emitter.find("vector"), emitter.find("ref")
            spectrum = deepcopy(spectra["band_7" if white else reference.get("id")])
            spectrum.attrib = {"type": "regular", "name": "irradiance"}
            values = spectrum.find("string")
            values.set("value", _text(power(j, np.array(values.get("value").split(), float))))
            emitter.remove(reference)
            emitter.append(spectrum)
            direction = turn(j, -np.array([float(vector.get(axis)) for axis in "xyz"]))
            vector.attrib |= {axis: f"{-value:.9f}" for axis, value in zip("xyz", direction)}
        tree.write(path)
        return load_scene(Path(folder) / f"{scene}.xml", size=size, **define)


def _text(values: np.ndarray) -> str:
    return " ".join(f"{value:.8g}" for value in values)


def told_wrong(recording: Recording, wrong: Wrong) -> Recording:
    """Let events come late, and tell the sensor's numbers wrong."""
    sensor, events = recording.sensor, recording.events
    sensor = replace(
        sensor,
        contrast_threshold_on=sensor.contrast_threshold_on * wrong.on,
        contrast_threshold_off=sensor.contrast_threshold_off * wrong.off,
        refractory_us=sensor.refractory_us * wrong.refractory,
    )
    return replace(recording, sensor=sensor, events=replace(events, t=events.t + wrong.late_us))


def fitted(ring, recording: Recording, truth: Truth, settings: Settings) -> tuple[Errors, Fit]:
    """Fit, time and judge."""
    profile = cProfile.Profile(time.process_time, builtins=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)  # what is told is not all true
        found = profile.runcall(fit, ring, recording, settings)
    stats = pstats.Stats(profile)
    inside = sum(row[3] for (_, _, name), row in stats.stats.items() if name == "find_shared")
    return errors_of(found, truth, stats.total_tt, inside / stats.total_tt), found


def errors_of(found: Fit, truth: Truth, seconds: float, share: float) -> Errors:
    """Compare maps with the truth."""
    maps, error = found.maps, score(found.maps, truth)
    known = maps.mask & truth.mask
    normal, true = maps.normal[known].astype(float), truth.normal[known].astype(float)
    angle = angular_error_deg(normal, true)
    mapped = normal @ nearest_map(normal, true)
    off = np.abs(maps.reflectance - truth.reflectance)[known] / maps.reflectance_sigma[known]
    return Errors(
        error["mae_deg"],
        angle.mean(),
        angular_error_deg(mapped, true).mean(),
        error["rmse"],
        (angle / maps.normal_sigma_deg[known] <= LEVELS).mean(axis=1),
        (off.ravel() <= LEVELS).mean(axis=1),
        seconds,
        share,
    )


def nearest_map(normal: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Give the 3 x 3 map that turns normals (n, 3) to the true ones whatever lengths come out: that of the least
    squares of what lies across the true ones."""
    across_true = np.eye(3) - true[:, :, None] * true[:, None]
    rows = np.einsum("ni,nkj->nkij", normal, across_true).reshape(-1, 9)
    found = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3)
    return found * np.sign(np.sum((normal @ found) * true))


def against_truth(
    found: Fit, case: Case, rig: Rig, given: Recording, pixelwise: Recording, truth: Truth
) -> tuple[dict, int]:
    """Compare what was inferred with what is true; see `Result.found`. Gives the steps that it took, too."""
    answer = found.decisions["LED powers"].answer  # of what is shared, one for all
    if answer is None:
        return {}, 0
    value, sigma, pixel, out = answer.inferred.rig, answer.inferred.sigma, case.watched.pixel, {}
    rate = 2e-6 * np.pi * pixel.cutoff_hz  # 1 / tau, per us
    for name, true in (("tau", 1 / rate), ("shift", case.wrong.late_us), ("refractory", pixel.refractory_us)):
        us, sigma_us = answer.us(name)
        out[name] = us, true, deviations(us, true, sigma_us)
    noise = np.sqrt(rate / (2 * pixel.photon_rate_per_us))  # see `EventPixel.photon_rate_per_us`
    out["noise"] = value.noise, noise, deviations(value.noise, noise, sigma.noise)
    leak, sigma_leak = found.decisions["leak"].found.values()
    true = pixel.leak_hz * pixel.contrast_threshold_on
    out["leak"] = leak, true, deviations(leak, true, sigma_leak)
    for k, name in enumerate(("on", "off")):
        told, of_pixels = (getattr(of.sensor, f"contrast_threshold_{name}") for of in (given, pixelwise))
        true = np.mean(np.log(np.broadcast_to(of_pixels, truth.mask.shape)[truth.mask] / told))
        z = deviations(value.log_threshold[k], true, sigma.log_threshold[k])
        out[f"C_{name}"] = float(np.exp(value.log_threshold[k])), float(np.exp(true)), z
    pairs = (
        ("powers", value.log_power, rig.log_power, sigma.log_power),
        (
            "directions",
            np.degrees(value.tilt),
            rig.tilt_deg,
            np.degrees(sigma.tilt),
        ),
    )
    for name, values, true, sigmas in pairs:
        if sigmas.any():
            out[name] = rms(values - true), rms(true), rms(deviations(values, true, sigmas))
    return out, answer.inferred.n_step


def deviations(values, true, sigma):
    """Give differences in units of sigma; infinite where that is 0."""
    with np.errstate(divide="ignore"):
        return np.subtract(values, true) / sigma


def rms(values: np.ndarray) -> float:
    """Give the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
