"""What the camera sees of the object's geometry and materials."""

import drjit as dr
import mitsuba as mi
import numpy as np

from evsdr.integrators.leds import Leds
from evsdr.integrators.pixels import pixel_mean
from evsdr.integrators.ring import camera_frame, find_object, rotate
from evsdr.light.camera import camera_geometry
from evsdr.light.scene import RingScene
from evsdr.model import quadrature
from evsdr.model.arrays import owned
from evsdr.records import Maps

TRUTH_NODES = 16  # of the quadrature of true reflectances: four times those of the renderer
TRUTH_TOLERANCE = 5e-3  # its error that is worth other nodes than Gauss's; guessed


def _central(ring: RingScene) -> tuple[mi.SurfaceInteraction3f, mi.Bool]:
    """Give what the pixels' centres see, and whether that is the object."""
    pixel = dr.arange(mi.UInt32, ring.height * ring.width)
    place = mi.Point2f(pixel % ring.width, pixel // ring.width) + 0.5
    ray, _ = ring.sensor.sample_ray(0.0, 0.5, place / mi.Point2f(ring.width, ring.height), mi.Point2f(0.5))
    si = ring.scene.ray_intersect(ray)
    return si, si.is_valid() & (si.shape == find_object(ring.scene))


def object_normals(ring: RingScene) -> np.ndarray:
    """Give the normals (height, width, 3) of the object at pixel centres, camera frame; (0, 0, 1) elsewhere."""
    si, seen = _central(ring)
    normal = rotate(camera_frame(ring.sensor), dr.mulsign(si.sh_frame.n, si.wi.z))
    normal = dr.select(seen, normal, mi.Vector3f(0, 0, 1))
    return np.stack([n.numpy() for n in normal], axis=-1).reshape(ring.height, ring.width, 3)


def object_depth(ring: RingScene) -> np.ndarray:
    """Give the depth (height, width) of the object at pixel centres [scene units]; 0 where it is not seen."""
    si, seen = _central(ring)
    _, to_world = camera_geometry(ring.sensor)
    distance = dr.dot(mi.Point3f(to_world[:3, 3]) - si.p, mi.Vector3f(to_world[:3, 2]))
    return dr.select(seen, distance, 0.0).numpy().reshape(ring.height, ring.width)


def _fine_quadrature(leds: Leds) -> tuple[mi.Float, list[mi.Float]]:
    """Give nodes of all bands in packets of four, more of them than the renderer uses, and weights for each band."""
    rules = [
        quadrature.quadrature_for(spectrum, leds.curves, TRUTH_NODES, TRUTH_TOLERANCE)
        for spectrum in leds.band_spectrum
    ]
    node, weight = (np.concatenate([np.ravel(rule[k]) for rule in rules]) for k in (0, 1))
    band = np.repeat(range(leds.n_band), [np.size(rule[0]) for rule in rules])
    return owned(mi.Float, node), [
        owned(mi.Float, np.where(band == b, weight, 0.0)) for b in range(leds.n_band)
    ]


def surface_maps(ring: RingScene, spp: int, seed: int = 0) -> Maps:
    """Give the true normals and band reflectances of the object, averaged over each pixel's area.

    The mask holds the pixels that the object covers whole, where back sides that reflect nothing, as those of an open tube, are none
    of it. Reflectance is that of diffuse reflection.
    """
    leds, frame = ring.leds, camera_frame(ring.sensor)
    nodes, weights = _fine_quadrature(leds)
    target = find_object(ring.scene)

    def measure(s, si, ray, rng, active):
        bsdf = si.bsdf(ray)
        reflects = (si.wi.z > 0) | mi.has_flag(bsdf.flags(), mi.BSDFFlags.BackSide)
        active = active & si.is_valid() & (si.shape == target) & reflects
        normal = rotate(frame, dr.mulsign(si.sh_frame.n, si.wi.z))

        def add(i, *total):
            here = mi.SurfaceInteraction3f(si)
            here.wavelengths = dr.gather(mi.Spectrum, nodes, i)
            seen = bsdf.eval_diffuse_reflectance(here, active)
            return (i + 1, *(t + dr.sum(dr.gather(mi.Spectrum, w, i) * seen) for t, w in zip(total, weights)))

        zero = [
            dr.zeros(mi.Float, dr.width(si.t)) for _ in weights
        ]  # a loop, as unrolled it takes seconds to compile
        n_packet = dr.width(nodes) // 4
        _, *reflectance = dr.while_loop((mi.UInt32(0), *zero), lambda i, *_: i < n_packet, add)
        values = [mi.Float(1.0), *normal, *reflectance]
        return [dr.select(active, v, 0.0) for v in values]

    values = pixel_mean(ring.scene, ring.sensor, spp, seed, 4 + leds.n_band, measure)
    dr.eval(values)
    shape = (ring.height, ring.width)
    coverage, *values = (v.numpy().reshape(shape) for v in values)
    mask = coverage > 1 - 1e-4
    normal = np.stack(values[:3], axis=-1)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(length > 0, normal / np.maximum(length, 1e-12), [0, 0, 1])
    reflectance = np.stack(values[3:], axis=-1) / np.maximum(coverage, 1e-6)[..., None]
    return Maps(
        normal=normal.astype(np.float32),
        reflectance=reflectance.astype(np.float32),
        mask=mask,
        normal_sigma_deg=np.zeros(shape, np.float32),
        reflectance_sigma=np.zeros_like(reflectance, dtype=np.float32),
        band_wavelength_nm=leds.band_wavelength_nm.astype(np.float32),
    )
