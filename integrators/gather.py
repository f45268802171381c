"""Inter-reflections for inverse problems: the ring's light gathered over known normals and reflectances.

A Lambertian pixel takes in the mean over its hemisphere, weighted by the cosine, of what the surfaces around it
send. In the integrator's unit that is the mean of their own signals A_yj, which on the object are those of its
pixels.
"""

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from evsdr.integrators.emission import recurrence, toward_led
from evsdr.integrators.leds import Leds
from evsdr.integrators.rays import fineness, spawn, spawn_toward

ON_LEDS = 0.8191725133961645, 0.6710436067037893  # of that in three dimensions: for the samples on LEDs
NEAR_ENOUGH = 3.0  # pixels between a point that a ray hits and what the camera sees there


@dataclass(frozen=True)
class Surface:
    """The object as its pixels show it.

    Attributes
    ----------
    shape : mi.ShapePtr
        Its geometry.
    place : mi.SurfaceInteraction3f, (n_pixel)
        What the pixels' centres see.
    normal : mi.Vector3f, (n_pixel)
        Unit normals, in the world.
    reflectance : list of mi.Float, (n_band) of width n_pixel
    known : mi.Bool, (n_pixel)
        Pixels of the object with normal and reflectance.
    pixel_of : callable (mi.Point3f) -> (mi.UInt32, mi.Bool)
        The pixel that sees a point of the world if nothing is before it, and whether there is one.
    pixel_size : float
        At the object's distance [scene units].
    """

    shape: mi.ShapePtr
    place: mi.SurfaceInteraction3f
    normal: mi.Vector3f
    reflectance: list
    known: mi.Bool
    pixel_of: object
    pixel_size: float


def gather(scene, leds: Leds, surface: Surface, signal: list, n_ray: int, seed: int, skip: float) -> list:
    """Gather what other surfaces send to each pixel: one inter-reflection more than `signal` holds.

    The object sends what its pixels show to the camera; parts that the camera does not see reflect direct light
    like the mean pixel, other shapes reflect direct light by their own materials.

    Parameters
    ----------
    signal : list of mi.Float, (n_led) of width n_pixel
        A_xj of the object's pixels.
    n_ray : int
        Rays per pixel.
    seed : int
        Of the rays.
    skip : float
        What is hit nearer than that is the surface itself [scene units].

    Returns
    -------
    list of mi.Float, (n_led) of width n_pixel
        Irradiance by way of other surfaces, in the unit of the direct one.
    """
    n_pixel, fine = dr.width(surface.place), fineness(scene)
    lanes = leds.in_lanes(scene, n_pixel)
    mean = _mean_reflectance(surface, leds)
    context = mi.BSDFContext()
    generator = mi.PCG32(size=n_pixel, initstate=dr.opaque(mi.UInt64, seed))
    shift, on_leds = (mi.Point2f(generator.next_float32(), generator.next_float32()) for _ in range(2))
    front = dr.mulsign(surface.place.n, dr.dot(surface.place.n, surface.place.to_world(surface.place.wi)))
    seen_at = dr.select(surface.known, surface.place.p, mi.Point3f(dr.inf))
    skip, near = dr.opaque(mi.Float, skip), dr.opaque(mi.Float, NEAR_ENOUGH * surface.pixel_size)
    signal = dr.concat(signal)
    of_pixels = surface.place, surface.known, surface.normal, front, shift, on_leds
    dr.eval(of_pixels, signal, seen_at, mean)
    pixel = dr.arange(mi.UInt32, dr.width(lanes[0].number)) % n_pixel
    of_lanes = (dr.gather(type(value), value, pixel) for value in of_pixels)
    place, known, normal, front, shift, on_leds = of_lanes
    frame = mi.Frame3f(normal)

    def body(k, *total):
        local = mi.warp.square_to_cosine_hemisphere(recurrence(shift, k))
        sample = recurrence(on_leds, k, ON_LEDS)
        ray = spawn(place, frame.to_world(local), fine)
        ray.o += skip * ray.d
        # fitted normals can look below the geometry's horizon
        above = known & (dr.dot(front, ray.d) > 0)
        si = scene.ray_intersect(ray, mi.RayFlags.All, coherent=False, active=above)
        hit = above & si.is_valid()
        own = hit & (si.shape == surface.shape)
        there, inside = surface.pixel_of(si.p)
        seen = own & inside
        seen &= dr.norm(dr.gather(mi.Point3f, seen_at, there, seen) - si.p) < near
        lit = hit & ~seen
        bsdf = si.bsdf(ray)
        facing = dr.mulsign(si.n, dr.dot(si.n, -ray.d))
        out = []
        for led, sent in zip(lanes, total):
            si.wavelengths = led.node_nm
            ds, geometry = toward_led(led, si, sample, lit)
            reflected = bsdf.eval(context, si, si.to_local(ds.d), lit & ~own)
            f_cos = dr.sum(reflected * led.weight) * dr.pi
            of_mean = dr.gather(mi.Float, mean, led.number) * dr.maximum(dr.dot(facing, ds.d), 0.0)
            strength = led.power * geometry * dr.select(own, of_mean, f_cos)
            open_ = lit & (strength > 0)
            open_ &= ~scene.ray_test(spawn_toward(si, ds, fine), False, open_)
            value = dr.select(open_, strength, 0.0)
            value += dr.gather(mi.Float, signal, led.number * n_pixel + there, seen)
            out.append(sent + value)
        return (k + 1, *out)

    zero = [dr.zeros(mi.Float, dr.width(pixel)) for _ in lanes]
    state = dr.while_loop((mi.UInt32(0), *zero), lambda k, *_: k < n_ray, body, label="gathering rays")
    of_leds = dr.reshape(mi.TensorXf, dr.concat(state[1:]) / n_ray, (-1, n_pixel))
    return [of_leds[j].array for j in range(leds.n_led)]


def _mean_reflectance(surface: Surface, leds: Leds) -> mi.Float:
    """Give the mean of the known pixels, for each LED that of its band."""
    count = max(int(dr.count(surface.known)[0]), 1)
    mean = [float(dr.sum(dr.select(surface.known, r, 0.0))[0]) / count for r in surface.reflectance]
    return mi.Float([mean[b] for b in leds.band])


def pixel_finder(width: int, height: int, pixel_size, center, perspective: bool, to_world: np.ndarray):
    """Make the callable `Surface.pixel_of` of a camera; arguments as in `depth.CameraGeometry`."""
    axes = [mi.Vector3f(axis) for axis in to_world[:3, :3].T.tolist()]
    origin = mi.Point3f(to_world[:3, 3].tolist())
    pixel_size, center = mi.Point2f(*pixel_size), mi.Point2f(*center)
    dr.make_opaque(axes, origin, pixel_size, center)  # no kernel holds where a camera stands

    def pixel_of(point):
        x, y, z = (dr.dot(axis, point - origin) for axis in axes)
        if perspective:
            x, y = x / -z, y / -z
        column = dr.floor(x / pixel_size[0] + center[0])
        row = dr.floor(center[1] - y / pixel_size[1])
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        return mi.UInt32(dr.select(inside, row * width + column, 0.0)), inside

    return pixel_of
