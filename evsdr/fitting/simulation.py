"""Simulate a recording of a scene, with what is true of it."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from evsdr.events.pixel import EventPixel
from evsdr.events.record import Thresholds, record, ring_schedule
from evsdr.light.entry import open_scene
from evsdr.records import Recording, Schedule, Truth

if TYPE_CHECKING:
    from evsdr.light.scene import RingScene

SPP, SOFT_SPP = 16, 64


def simulate(
    scene: "RingScene | str | Path | dict",
    pixel: EventPixel = EventPixel(),
    schedule: Schedule | None = None,
    rounds: int = 6,
    seed: int = 0,
    thresholds: Thresholds = "calibrated",
    spp: int | None = None,
    led_rise_us: float = 0.0,
    progress: Callable[[str, float], None] | None = None,
) -> tuple[Recording, Truth]:
    """Simulate what event pixels record of a scene under its ring.

    Parameters
    ----------
    scene : RingScene, path or dict
        See `load_scene`.
    pixel : EventPixel
        By default that of an EVK4.
    schedule : Schedule, optional
        Which LED is lit when; by default each in turn, for 20 ms, fading all the while into the next.
    rounds : int
        How often the ring goes round.
    seed : int
        Of everything random; the same gives the same events.
    thresholds : str
        What the recording tells of the thresholds: those of each pixel, or one nominal value.
    spp : int, optional
        Rays per pixel; see `render`.
    led_rise_us : float
        Time constant of an LED's light [us].
    progress : callable (stage, share), optional
        Told what is under way, and which share of it, 0..1, is done.

    Returns
    -------
    recording : Recording
        Without events where nothing changes enough.
    truth : Truth

    Raises
    ------
    InputError
        Something given can't be used.
    """
    tell = progress or (lambda stage, share: None)
    tell("render", 0.0)
    ring = open_scene(scene) if isinstance(scene, str | Path | dict) else scene
    signal, truth = render(ring, spp, seed)
    recording = record(
        signal,
        ring.constant_light,
        pixel,
        schedule or ring_schedule(ring.leds.n_led),
        rounds,
        seed,
        thresholds,
        led_rise_us,
        lambda _, share: tell("events", share),
    )
    return recording, truth


def render(ring: "RingScene", spp: int | None = None, seed: int = 0) -> tuple[np.ndarray, Truth]:
    """Render the LED images of a scene and what is true of it.

    Parameters
    ----------
    ring : RingScene
    spp : int, optional
        Rays per pixel; by default 16, and 64 where LEDs have a surface or light goes by way of others: such
        noise is not real.
    seed : int
        Of the rays.

    Returns
    -------
    signal : (n_led, height, width) float32
        A_xj.
    truth : Truth
    """
    from evsdr.light.ground_truth import surface_maps
    from evsdr.light.tracing import led_images

    sharp = ring.integrator.max_depth == 1 and all(e.get_shape() is None for e in ring.leds.emitter)
    spp = spp or (SPP if sharp else SOFT_SPP)
    maps = surface_maps(ring, spp, seed)
    return led_images(ring, spp, seed), Truth(maps.normal, maps.reflectance, maps.mask)
