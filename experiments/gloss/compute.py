"""A glossy sphere: what gloss costs, and what robust weights and a modelled lobe save."""

import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import evsdr
from evsdr import EventPixel, InputWarning, Recording, Schedule, Settings, Truth

SCENES = Path(__file__).resolve().parents[2] / "scenes"
SHININESS, STRENGTH = 32.0, 0.3  # of the Blinn-Phong sphere; the shininess is the paper's
NOISE = 0.1  # of each threshold, from event to event
N_ROUND, SLOT_US = 6, 20_000.0


@dataclass(frozen=True)
class Sphere:
    """A simulated recording, ready to fit.

    Attributes
    ----------
    name : str
        `matt`, `coating` or `blinn-phong`.
    scene : RingScene
    recording : Recording
    truth : Truth
    """

    name: str
    scene: object
    recording: Recording
    truth: Truth


@dataclass(frozen=True)
class Result:
    """What one method reached.

    Attributes
    ----------
    method : str
    error : dict
        See `evsdr.score`.
    seconds : float
        Of all cores.
    note : str
        What it found of the gloss.
    """

    method: str
    error: dict
    seconds: float
    note: str = ""


def simulate(name: str, size: int, seed: int = 0) -> Sphere:
    """Simulate the sphere `matt`, `coating` or `blinn-phong` with 10 % noise on thresholds.

    Mitsuba has no Blinn-Phong: that lobe is added to the images of the matt sphere.
    """
    file = "glossy_sphere.xml" if name == "coating" else "sphere.xml"
    scene = evsdr.load_scene(SCENES / file, size=size)
    pixel = EventPixel(event_noise=NOISE).idealised()
    if name != "blinn-phong":
        return Sphere(name, scene, *evsdr.simulate(scene, pixel, rounds=N_ROUND, seed=seed))
    from evsdr.fitting.simulation import render
    from evsdr.light.tracing import light_at_centre

    signal, truth = render(scene)
    signal = signal + truth.mask * blinn_phong(truth.normal, light_at_centre(scene))
    schedule = Schedule(np.arange(len(signal), dtype=np.int32), SLOT_US, 1.0)
    recording = evsdr.record(signal, scene.constant_light, pixel, schedule, N_ROUND, seed)
    return Sphere(name, scene, recording, truth)


def blinn_phong(normal: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Give the signal (n_led, H, W) of a lobe k (n . h)^m under far LEDs with light vectors (n_led, 3)."""
    power = np.linalg.norm(light, axis=1, keepdims=True)
    half = light / power + [0, 0, 1]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    lobe = STRENGTH * np.maximum(np.einsum("yxk,jk->jyx", normal, half), 0) ** SHININESS
    return np.where(np.einsum("yxk,jk->jyx", normal, light) > 0, power[:, :, None] * lobe, 0)


KNOWN = Settings(thresholds="known", refractory="known", lag="off")  # what else the recording holds
METHODS = {
    "robust, width 2 (default)": replace(KNOWN, gloss="off"),
    "robust, width 1": replace(KNOWN, gloss="off", shadows="downweight"),
    "lobe found": KNOWN,
    "lobe found, blinn-phong": replace(KNOWN, gloss="blinn-phong"),
}


def run(sphere: Sphere, method: str) -> Result:
    """Apply one method, score it and time it."""
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)  # that the model does not hold: here on purpose
        found = evsdr.fit(sphere.scene, sphere.recording, METHODS[method])
    seconds = time.process_time() - begin
    return Result(method, evsdr.score(found.maps, sphere.truth), seconds, found.summary["model"]["gloss"])
