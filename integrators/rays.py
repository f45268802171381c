"""Rays that leave a surface: begun so far above it as rounding asks for, in scenes of any unit.

Mitsuba begins them (1 + max |p|) 9e-5 above a point p: in a scene of some millimetres, told in metres, that jumps over what
casts shadows. Where all coordinates of a scene are below 1, their largest takes the place of the 1.
"""

import drjit as dr
import mitsuba as mi
import numpy as np


def fineness(scene: mi.Scene) -> mi.Float | None:
    """Give by how much closer to surfaces rays begin than in Mitsuba; None for a scene in which that would change nothing."""
    box = scene.bbox()
    largest = float(np.max(np.abs([np.array(box.min), np.array(box.max)])))
    return dr.opaque(mi.Float, largest) if 0 < largest < 1 else None


def spawn(si, direction, fine: mi.Float | None) -> mi.Ray3f:
    """Begin a ray at a surface point."""
    if fine is None:
        return si.spawn_ray(direction)
    return mi.Ray3f(_above(si, direction, fine), direction, si.time, si.wavelengths)


def spawn_toward(si, ds, fine: mi.Float | None) -> mi.Ray3f:
    """Begin a ray at a surface point that ends before a sampled place, or nowhere if that is infinitely far."""
    far = dr.isinf(ds.dist)
    ray = spawn(si, dr.select(far, ds.d, ds.p - si.p), fine)
    way = dr.select(far, ds.d, ds.p - ray.o)
    length = dr.norm(way)
    ray.d = way / length
    ray.maxt = dr.select(far, dr.largest(mi.Float), length * (1 - mi.math.ShadowEpsilon))
    return ray


def _above(si, direction, fine):
    """Move a surface point to the side that a direction leaves it on."""
    step = fine * (1 + dr.max(dr.abs(si.p))) * mi.math.RayEpsilon
    return si.p + dr.mulsign(step, dr.dot(si.n, direction)) * si.n
