"""Simulation-based calibration of what all pixels share (Talts et al. 2018): truths drawn from what is told of them.

Each recording has its own truth: log powers and directions of the LEDs, thresholds, refractory period, shift, lag, noise
of the photoreceptors and leak, all drawn from `Told`, by which a fit widens what it is told. Ranks of the truths in what
the fits found, Gaussians of one sigma, are then uniform, and z = (found - true) / sigma has a mean square of 1.
"""

import warnings
from dataclasses import replace

import numpy as np

from evsdr import EventPixel, Fit, InputWarning, Settings, fit
from evsdr.solve.shared.rig import TIMES, Rig, Told

from ..shared.compute import Case, Watched, Wrong, record, told_rig, told_wrong
from .statistics import LEVELS, level_of_each, rank_of_value, uniformity

SCENE = "sphere"
TOLD = Told()
SHORTEST_TAU_US, LEAST_NOISE = 1.0, 1e-3  # below which no pixel is


def draw_case(rng: np.random.Generator) -> Case:
    """Draw a rig, and what is told of it."""
    pixel = EventPixel()
    tau_us = max(TOLD.tau_us * abs(rng.normal()), SHORTEST_TAU_US)
    noise = max(TOLD.noise * abs(rng.normal()), LEAST_NOISE)
    pixel = replace(
        pixel,
        cutoff_hz=1e6 / (2 * np.pi * tau_us),
        photon_rate_per_us=1 / (2 * tau_us * noise**2),  # see `EventPixel.photon_rate_per_us`
        leak_hz=TOLD.leak * abs(rng.normal()) / pixel.contrast_threshold_on,
    )
    factor_on, factor_off = np.exp(TOLD.thresholds * rng.normal(size=2))
    wrong = Wrong(
        power=TOLD.powers,
        tilt_deg=TOLD.directions_deg,
        late_us=round(TOLD.shift_us * rng.normal()),
        refractory=max(1 + TOLD.refractory_us / pixel.refractory_us * rng.normal(), 0.0),
        on=factor_on,
        off=factor_off,
    )
    return Case("drawn", Watched(pixel=pixel), wrong)


def compare(size: int, seed: int) -> dict[str, np.ndarray]:
    """Record and fit once; gives z of all that is shared, by name; what was taken as told counts as found there."""
    case = draw_case(np.random.default_rng([seed, 4]))
    recording, pixelwise, truth = record(case.watched, SCENE, size, seed)
    rig, given = told_rig(case, SCENE, size, seed), told_wrong(recording, case.wrong)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)  # what is told is not true
        found = fit(rig.scene, given, Settings(leds_told_to=TOLD.directions_deg))
    return deviations(found, true_rig(case, rig, given, pixelwise, truth))


def true_rig(case: Case, rig, given, pixelwise, truth) -> Rig:
    """Give what is true of a recording, as a fit would find it."""
    pixel, slot_us = case.watched.pixel, case.watched.slot_us
    rate = 2e-6 * np.pi * pixel.cutoff_hz  # 1 / tau, per us
    noise = np.sqrt(rate / (2 * pixel.photon_rate_per_us))
    leak = pixel.leak_hz * pixel.contrast_threshold_on * 1e-6 * slot_us
    log_threshold = [
        np.mean(np.log(np.broadcast_to(getattr(pixelwise.sensor, name), truth.mask.shape)[truth.mask]))
        - np.log(getattr(given.sensor, name))
        for name in ("contrast_threshold_on", "contrast_threshold_off")
    ]
    times = 1 / rate / slot_us, 0.0, noise, case.wrong.late_us / slot_us, pixel.refractory_us / slot_us
    return Rig(rig.log_power, *times, leak, np.nan, np.array(log_threshold), np.radians(rig.tilt_deg))


def deviations(found: Fit, true: Rig) -> dict[str, np.ndarray]:
    """Give (found - true) / sigma (n,) of what was inferred, by name."""
    answer = found.decisions["photoreceptor lag"].answer
    if answer is None:
        return {}
    value, sigma, out = answer.inferred.rig, answer.inferred.sigma, {}
    for name in ("log_power", *TIMES, "log_threshold", "tilt"):
        of_value, of_true, of_sigma = (np.ravel(getattr(rig, name)) for rig in (value, true, sigma))
        if (of_sigma > 0).all():
            out[name] = (of_value - of_true) / of_sigma
    return out


def report(seeds: range, size: int) -> int:
    """Print how the truths lie among what was found."""
    found = [compare(size, seed) for seed in seeds]
    names = [name for name in ("log_power", *TIMES, "log_threshold", "tilt") if any(name in z for z in found)]
    print("| shared | inferred in | mean z | mean z^2 | % within 1 2 3 | p |\n|---|---|---|---|---|---|")
    for name in names:
        z = [one[name] for one in found if name in one]
        together = np.concatenate(z)
        shares = " ".join(f"{100 * np.mean(np.abs(together) <= level):.0f}" for level in LEVELS)
        p = uniformity([rank_of_value(one) for one in z]).p
        squares = np.mean(together), np.mean(together**2)
        print(
            f"| {name} | {len(z)} of {len(found)} | {squares[0]:+.2f} | {squares[1]:.1f} | {shares} | {p:.1g} |"
        )
    print(f"\nrefused by chi-square with Sidak's correction below p = {level_of_each(len(names)):.1g}")
    return 0
