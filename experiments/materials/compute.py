"""Record each material, fit it as a user would, and compare."""

import time
import warnings
from dataclasses import dataclass, replace

import numpy as np

import evsdr
from evsdr import EventPixel, InputWarning, Recording, Settings, Truth, angular_error_deg
from evsdr.events.record import record, ring_schedule

from .scenes import Case

N_ROUND = 6
LIT = 0.05  # n . l from which a shadow on a translucent surface is a cast one


@dataclass(frozen=True)
class Result:
    """What came of a case.

    Attributes
    ----------
    name : str
    known : float
        Share of the object's pixels.
    error_deg, median_deg, sigma_deg : float
        Of the normals of known pixels; the last is a median.
    within, reflectance_within : tuple of 3 float
        Share of them within one, two, three sigma.
    seconds : float
    modelled, verdict : str
        As the summary says.
    metal : bool
    """

    name: str
    known: float
    error_deg: float
    median_deg: float
    sigma_deg: float
    within: tuple[float, ...]
    reflectance_within: tuple[float, ...]
    seconds: float
    modelled: str
    verdict: str
    metal: bool


def run(case: Case, size: int, settings: Settings, seed: int = 0) -> Result:
    """Record, fit and compare one case; thresholds are told as one value."""
    recording, truth = recorded(case, size, seed)
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        fit = evsdr.fit(evsdr.load_scene(case.told, size=size), recording, settings, truth.mask)
    seconds = time.perf_counter() - begin
    maps, known = fit.maps, fit.maps.mask & truth.mask
    error, sigma = angular_error_deg(maps.normal, truth.normal)[known], maps.normal_sigma_deg[known]
    off, spread = np.abs(maps.reflectance - truth.reflectance)[known], maps.reflectance_sigma[known]
    return Result(
        case.name,
        known.sum() / truth.mask.sum(),
        float(error.mean()),
        float(np.median(error)),
        float(np.median(sigma)),
        tuple(float(np.mean(error <= k * sigma)) for k in (1, 2, 3)),
        tuple(float(np.mean(off <= k * spread)) for k in (1, 2, 3)),
        seconds,
        "; ".join(
            fit.decisions[name].why for name in ("metal", "gloss", "translucency") if name in fit.decisions
        ),
        fit.summary["verdict"],
        case.metal,
    )


def recorded(case: Case, size: int, seed: int) -> tuple[Recording, Truth]:
    """Record an EVK4's events."""
    ring = evsdr.load_scene(case.true, size=size)
    if case.wrap:
        signal, truth = wrapped(ring, case.wrap)
        schedule = ring_schedule(ring.leds.n_led)
        recording = record(signal, ring.constant_light, EventPixel(), schedule, N_ROUND, seed)
    else:
        recording, truth = evsdr.simulate(ring, rounds=N_ROUND, seed=seed)
    return one_value(recording), truth


def one_value(recording: Recording) -> Recording:
    """Tell thresholds as two numbers, as makers do."""
    names = "contrast_threshold_on", "contrast_threshold_off"
    mean = {name: float(np.mean(getattr(recording.sensor, name))) for name in names}
    return replace(recording, sensor=replace(recording.sensor, **mean))


def wrapped(ring, wrap: float) -> tuple[np.ndarray, Truth]:
    """Give the signals (n_led, H, W) of a translucent surface, from normals and cast shadows of a matt one."""
    from evsdr.fitting.simulation import render
    from evsdr.light.tracing import trace_illumination

    signal, truth = render(ring)
    lit, seen = (trace_illumination(ring, 16, shadows)[0] for shadows in (False, True))
    out = np.zeros_like(signal)
    for j, (direction, band) in enumerate(zip(lit.direction, lit.band)):
        cosine = truth.normal @ np.array(direction).reshape(3, -1).mean(axis=1)
        all_light, light = (np.resize(i.irradiance[j].numpy(), truth.mask.shape) for i in (lit, seen))
        light = np.where(cosine < LIT, all_light, light)
        out[j] = (
            truth.mask * truth.reflectance[..., band] * light * np.maximum((cosine + wrap) / (1 + wrap), 0)
        )
    return out, truth
