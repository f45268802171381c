"""Recordings by foreign pixels of a sphere under a ring, and how well a fit explains them.

`python -m experiments.shared --pixels` prints a table of them.
"""

import warnings
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

import evsdr
from evsdr.fitting.simulation import render
from evsdr.records import Events, Recording, Schedule, Sensor, Truth
from tests.support.foreign_pixel import ForeignEvents, ForeignPixel, watch
from tests.support.small_scene import camera, leds, scene

SCENE = Path(__file__).parents[2] / "scenes" / "sphere.xml"
SPP = 16  # rays per pixel
WHITE_LED = ("red",)  # one band, whatever its colour
DN = 255  # I = 1 in the grey levels that DVS-Voltmeter and v2e are told in


class Watched(NamedTuple):
    """What a pixel watches: 24 LEDs of 8 bands before `sphere.xml`, or of one, as a white LED on a circle."""

    pixel: ForeignPixel
    slot_us: float = 20_000.0
    crossfade: float = 1.0
    n_round: int = 6
    white: bool = False


# README of rpg_vid2e: thresholds 0.2, no rest. How far frames are apart is a guess.
ESIM = ForeignPixel(0.2, 0.2, steps=True, drops=True, frame_us=500)
# Its config.py for a DAVIS346, K = (5.265, 20, 1e-4, 1e-7, 5e-9, 1e-5): gain, dark light, shot noise, leak,
# leak of light, noise; voltages in thresholds and light in grey levels, so that K1 is 1 / C.
K1 = 0.00018 * 29250
VOLTMETER = ForeignPixel(
    1 / K1,
    1 / K1,
    dark_light=20 / DN,
    walk_shot=1e-4 / np.sqrt(DN) / K1,
    walk_floor=1e-5 / K1,
    leak_per_us=1e-7 / K1,
    leak_of_light=5e-9 * DN / K1,
)
# C = 0.15 of an IMX636 at bias_diff -20, up to 20 % more or less at each event; the rest of bias_refr -20.
EVENTPS = ForeignPixel(0.15, 0.15, event_noise=0.2 / 3**0.5, uniform=True, refractory_us=364, frame_us=500)
# Class defaults of IEBCS: thresholds 0.2 with noise of 0.02, latency, jitter, rest; time constant 40 us at
# 1 klux as in its example; noise events as in its file for 161 lux (two thirds of the pixels silent, hardly
# any OFF).
IEBCS = ForeignPixel(
    0.2,
    0.2,
    event_noise=0.1,
    refractory_us=50,
    tau_us=40,
    latency_us=100,
    jitter_us=30,
    noise_on_hz=0.105,
    noise_off_hz=0.002,
    noise_spread=1.0,
)
# README of IEBCS: thresholds 0.3 with noise of 0.05, latency 200 us, jitter 50 us, time constant 300 us;
# noise events as in its file for 0.1 lux. That latency and jitter double at I = 0.1 is a guess.
IEBCS_DIM = ForeignPixel(
    0.3,
    0.3,
    event_noise=1 / 6,
    refractory_us=50,
    tau_us=300,
    latency_us=200,
    jitter_us=50,
    delay_doubles_at=0.1,
    noise_on_hz=5.6,
    noise_off_hz=4.2,
    noise_spread=0.55,
)
# Defaults of v2e: thresholds 0.2 with mismatch 0.03, cutoff 300 Hz at (I + 20) / 275 in grey levels, 500 us
# of rest that only delays, leak 0.01 Hz. Noise events of 1 Hz, a quarter of them at white, are between its
# default (0.001) and its `noisy` (5). Its logarithm that turns straight below 20 grey levels is left out:
# no pixel does that.
V2E = ForeignPixel(
    0.2,
    0.2,
    mismatch_on=0.03,
    mismatch_off=0.03,
    refractory_us=500,
    steps=True,
    tau_us=1e6 / (2 * np.pi * 300) * 275 / DN,
    lag_light=20 / DN,
    leak_per_us=0.01 * 0.2e-6,
    noise_on_hz=0.5,
    noise_off_hz=0.5,
    noise_at_white=0.25,
    noise_resets=False,
)
# Thresholds, mismatch and rest measured on an EVK4 (IMX636) at default biases. All else is a guess: 3 kHz
# at I = 1 and a source follower of 10 us, a dark current of 0.002, noise of 0.01 in log light, read-out of
# a million events a second for this small region.
EVK4_LIKE = ForeignPixel(
    0.2525,
    0.3795,
    mismatch_on=0.049,
    mismatch_off=0.039,
    event_noise=0.02,
    refractory_us=52,
    tau_us=53,
    follower_us=10,
    dark_light=0.002,
    photons_per_us=100,
    latency_us=20,
    jitter_us=5,
    delay_doubles_at=0.1,
    noise_on_hz=0.5,
    noise_off_hz=0.1,
    noise_spread=1.0,
    per_event_us=1,
    patience_us=1000,
    leak_per_us=0.1 * 0.25e-6,
)
# Shot noise of 0.03 in log light, an eighth of a threshold, in light that takes 1.2 s to go round: guesses.
SLOW = EVK4_LIKE._replace(photons_per_us=10, follower_us=0, mismatch_on=0, mismatch_off=0)

WATCHED = {
    "esim": Watched(ESIM),
    "esim_1ms_clock": Watched(ESIM._replace(clock_us=1000)),
    "voltmeter": Watched(VOLTMETER),
    "eventps": Watched(EVENTPS),
    "iebcs": Watched(IEBCS),
    "iebcs_dim": Watched(IEBCS_DIM),
    "v2e": Watched(V2E),
    "v2e_no_lag": Watched(V2E._replace(tau_us=0)),
    "evk4_like": Watched(EVK4_LIKE),
    "evk4_like_2ms": Watched(EVK4_LIKE, slot_us=2_000),
    "slow_white": Watched(SLOW, slot_us=50_000, white=True, n_round=4),
}


class Report(NamedTuple):
    """How far the maps of a fit are from the truth; shares are of the known pixels within 1, 2, 3 sigma."""

    mae_deg: float
    rmse: float
    reflectance_ratio: float
    within: np.ndarray
    reflectance_within: np.ndarray
    known: float
    fit: evsdr.Fit


def open_ring(watched: Watched, size: int, constant_light: float):
    """Load the scene that is watched, as a fit is told of it."""
    if not watched.white:
        return evsdr.load_scene(SCENE, size=size, constant_light=constant_light)
    text = scene(sensor=camera(width=size, height=size), light=leds(24, WHITE_LED))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.xml"
        path.write_text(text)
        return evsdr.load_scene(path, constant_light=constant_light)


def record(watched: Watched, size: int = 48, seed: int = 0, constant_light: float = 0.05):
    """Record a sphere; gives the scene as a fit is told of it, the recording and the truth.

    The recording tells thresholds as one value each, and as rest the time whose change of light is lost.
    Dark current is constant light to the pixel, and told as such.
    """
    pixel = watched.pixel
    ring = open_ring(watched, size, constant_light + pixel.dark_light)
    signal, truth = render(ring, SPP)
    order = np.arange(len(signal), dtype=np.int32)
    events = watch(signal, constant_light, order, *watched[1:4], pixel, seed)
    rest_us = 0.0 if pixel.steps else pixel.refractory_us
    sensor = Sensor(size, size, pixel.on, pixel.off, rest_us)
    schedule = Schedule(order, watched.slot_us, watched.crossfade)
    return ring, as_recording(events, sensor, schedule), truth


def as_recording(events: ForeignEvents, sensor: Sensor, schedule: Schedule) -> Recording:
    """Give events and triggers as a recording, which `evsdr.write_recording` writes as an events.h5."""
    x, y, p, t, round_start_us = events
    columns = x.astype(np.uint16), y.astype(np.uint16), p.astype(np.int8), t.astype(np.int64)
    return Recording(Events(*columns), sensor, schedule, round_start_us, "a foreign pixel")


def judge(ring, recording: Recording, truth: Truth, **settings) -> Report:
    """Fit a recording and compare the maps with the truth."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", evsdr.InputWarning)  # what is told is not all true
        found = evsdr.fit(ring, recording, evsdr.Settings(**settings))
    maps, error = found.maps, evsdr.score(found.maps, truth)
    known = maps.mask & truth.mask
    angle = evsdr.angular_error_deg(maps.normal, truth.normal)
    sigmas = angle[known] / maps.normal_sigma_deg[known]
    off = np.abs(maps.reflectance - truth.reflectance)[known] / maps.reflectance_sigma[known]
    ratio = np.median(maps.reflectance[known] / truth.reflectance[known])
    levels = np.arange(1, 4)[:, None]
    within = (sigmas <= levels).mean(axis=1)
    reflectance_within = (off.ravel() <= levels).mean(axis=1)
    share = known.sum() / truth.mask.sum()
    return Report(error["mae_deg"], error["rmse"], ratio, within, reflectance_within, share, found)
