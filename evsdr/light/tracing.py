"""Trace what the LEDs send to the pixels, directly and by way of other surfaces."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np

from evsdr.integrators.emission import mean_vectors
from evsdr.integrators.gather import Surface, gather, pixel_finder
from evsdr.integrators.ring import camera_frame, find_object, rotate
from evsdr.light.camera import camera_geometry
from evsdr.light.ground_truth import _central
from evsdr.light.scene import RingScene
from evsdr.model.arrays import columns, owned
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import led_signals
from evsdr.records import Maps

GATHER_RAYS = 64  # per pixel, of indirect light
MOST_GATHERINGS = 3  # more inter-reflections hardly add light


def led_images(ring: RingScene, spp: int, seed: int = 0) -> np.ndarray:
    """Render A_xj, without the constant light.

    Returns
    -------
    (n_led, height, width) float32
    """
    images = ring.integrator.signals(ring.scene, ring.sensor, spp, seed).numpy()
    return images if ring.trim is None else images * ring.trim[:, None, None].astype(np.float32)


def trace_illumination(
    ring: RingScene, spp: int, shadows: bool, seed: int = 0, skip: float = 0.0
) -> tuple[Illumination, np.ndarray]:
    """Trace what the LEDs send to each pixel of the object, and how much of the pixel it covers.

    Parameters
    ----------
    spp : int
        Rays per pixel.
    shadows : bool
        Trace cast shadows.
    skip : float
        Occluders nearer than that don't count [scene units].

    Returns
    -------
    Illumination
        Arrays of width 1 or height * width.
    coverage : (height, width) float32
    """
    light, coverage = ring.integrator.illumination(ring.scene, ring.sensor, spp, seed, shadows, skip)
    if ring.trim is not None:
        trim = [dr.opaque(mi.Float, t) for t in ring.trim.tolist()]
        light = replace(light, irradiance=[e * t for e, t in zip(light.irradiance, trim)])
    dr.eval(light.direction, light.irradiance, coverage)
    return light, coverage.numpy().reshape(ring.height, ring.width)


def trace_indirect(
    ring: RingScene, maps: Maps, light: Illumination, max_depth: int, seed: int, skip: float
) -> list[mi.Float]:
    """Gather what each LED sends to the object by way of other surfaces.

    Parameters
    ----------
    maps : Maps
        Normals and reflectances of the object as far as they are known: where a reflectance is not 0.
    light : Illumination
        The direct light that reaches the pixels; arrays of width 1 or height * width.
    max_depth : int
        Surface points on a light path; one gathering is made for each after the first, 3 at most.
    skip : float
        What is hit nearer than that is the surface itself [scene units].

    Returns
    -------
    list of mi.Float, (n_led) of width height * width
        Irradiance, in the unit of the direct one.
    """
    camera, to_world = camera_geometry(ring.sensor)
    place, seen = _central(ring)
    normal = mi.Vector3f(*columns(mi.Float, maps.normal.reshape(-1, 3)))
    # no surface sends more than it gets: a fit without indirect light may say so, and rounds would not settle
    reflectance = columns(mi.Float, np.minimum(maps.reflectance, 1).reshape(-1, maps.reflectance.shape[-1]))
    known = seen & (owned(mi.Float, (maps.reflectance > 0).any(axis=-1).ravel()) > 0)
    distance = dr.dot(mi.Point3f(to_world[:3, 3]) - place.p, mi.Vector3f(to_world[:3, 2]))
    scale = float(dr.max(dr.select(known, distance, 0.0))[0]) if camera.perspective else 1.0
    surface = Surface(
        shape=find_object(ring.scene),
        place=place,
        normal=rotate(to_world[:3, :3], normal),
        reflectance=reflectance,
        known=known,
        pixel_of=pixel_finder(
            ring.width, ring.height, camera.pixel_size, camera.center, camera.perspective, to_world
        ),
        pixel_size=max(camera.pixel_size) * scale,
    )
    direct = led_signals(replace(light, indirect=None), normal, reflectance)
    out = [dr.zeros(mi.Float, ring.width * ring.height)] * ring.leds.n_led
    for _ in range(min(max(max_depth - 1, 1), MOST_GATHERINGS)):
        signal = [a + reflectance[b] * e for a, b, e in zip(direct, light.band, out)]
        out = gather(ring.scene, ring.leds, surface, signal, GATHER_RAYS, seed, skip)
        dr.eval(out)
    return out


def light_at_centre(ring: RingScene) -> np.ndarray:
    """Give the light vectors (n_led, 3) at the centre of the object, in the camera frame."""
    box = next(s for s in ring.scene.shapes() if s.id() == "object").bbox()
    place, frame = mi.Point3f(0.5 * (box.min + box.max)), camera_frame(ring.sensor)
    vectors = [rotate(frame, v) for v in mean_vectors(ring.leds, range(ring.leds.n_led), place)]
    return ring.leds.power[:, None] * np.array([np.array(v, float).ravel() for v in vectors])
