"""What an LED sends to a place, nothing in between: from far away, from a point, or from all of its surface.

A surface is that of any Mitsuba shape with an `area` emitter. Mitsuba samples directions to it; what arrives from each
sample is radiance over density, which holds the fall-off, the cosine at the LED, and 0 where it faces away. One set of
samples thereby gives irradiance and direction, visibility, and how widely directions spread.
"""

from collections.abc import Iterable
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np
from evsdr.integrators.leds import Led, Leds, is_far

# Samples of a Fibonacci lattice, which its own number and the one before it make; measured on LEDs as wide as a fifth of
# their distance: directions within 0.15 degrees and irradiances within 0.3 %. Many are needed where some faces or sides
# face away.
POINT, SMOOTH, MANY = (1, 1), (89, 55), (377, 233)
SEQUENCE = 0.7548776662466927, 0.5698402909980532  # additive recurrence of low discrepancy in the unit square


def toward_led(led: Led, si, sample, active):
    """Sample an LED as seen from a surface point, nothing in between.

    Returns
    -------
    ds : mi.DirectionSample3f
        Direction to the LED, in the world, its point, and how far that is: infinitely where direction is all there is.
    geometry : mi.Float
        Fall-off g: what arrives, relative to the LED's spectrum.
    """
    seen = si.p, mi.Float(led.peak_nm), sample, active
    if len(led.choice) == 1:
        ds, arriving = _sample(led.choice[0], *seen)
    else:  # not by a pointer: Mitsuba would put the emitters of all scenes that there are into the kernel
        ds, arriving = dr.switch(led.copy, [partial(_sample, emitter) for emitter in led.choice], *seen)
    return ds, dr.select(active, arriving / led.peak, 0.0)


def _sample(emitter: mi.Emitter, place: mi.Point3f, nm: mi.Float, sample: mi.Point2f, active: mi.Bool):
    """Give a direction sample of an emitter and what arrives from it at a wavelength."""
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.p, si.wavelengths = place, mi.Spectrum(nm)
    ds, arriving = emitter.sample_direction(si, sample, active)
    if is_far(emitter):  # Mitsuba's point hangs on the size of the scene, which kernels would hold
        ds.p, ds.dist = place, mi.Float(dr.inf)
    return ds, arriving[0]


def mean_vectors(leds: Leds, chosen: Iterable[int], place: mi.Point3f) -> list[mi.Vector3f]:
    """Average g d, fall-off times direction, over the surfaces of some LEDs, nothing in between.

    The samples are the points of a Fibonacci lattice (Sloan and Joe 1994, "Lattice Methods for Multiple Integration",
    section 4.3), the same everywhere: no chance is in it.
    """
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.p = place
    found = {}
    for n, step in (POINT, SMOOTH, MANY):
        group = [j for j in chosen if _lattice(leds, j) == (n, step)]

        def body(k, *total, group=group, n=n, step=step):
            sample = _lattice_point(mi.Float(k), n, step)
            vectors = []
            for j, sent in zip(group, total):
                ds, geometry = toward_led(leds.one(j), si, sample, mi.Bool(True))
                vectors.append(sent + geometry * ds.d)
            return (k + 1, *vectors)

        if group:
            zero = [dr.zeros(mi.Vector3f, dr.width(place)) for _ in group]
            state = (mi.UInt32(0), *zero)
            state = dr.while_loop(
                state, lambda k, *_, n=n: k < n, body, label="samples of LEDs", max_iterations=-1
            )
            found |= {j: total / n for j, total in zip(group, state[1:])}
    return [found[j] for j in chosen]


def largest_spread(leds: Leds, place) -> float:
    """Give the standard deviation of the direction to a point of the widest LED, along its longer side [rad], from a place."""
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.p = mi.Point3f(place)
    dr.make_opaque(si.p)
    sampled = []
    with dr.suspend_grad():
        for j, emitter in enumerate(leds.emitter):
            if emitter.get_shape() is not None:
                n, step = _lattice(leds, j)
                sample = _lattice_point(mi.Float(dr.arange(mi.UInt32, n)), n, step)
                ds, geometry = toward_led(leds.one(j), si, sample, mi.Bool(True))
                sampled.append((ds.d, geometry))
        dr.eval(sampled)
    spreads = [0.0]
    for d, geometry in sampled:
        direction, weight = np.array(d, float), np.array(geometry, float)
        if weight.sum() > 0:
            widest = np.linalg.eigvalsh(np.cov(direction, aweights=weight, ddof=0))[-1]
            spreads.append(float(np.sqrt(widest)))
    return max(spreads)


def with_surface(leds: Leds) -> list[int]:
    """Give the LEDs that have a surface."""
    return [j for j, emitter in enumerate(leds.emitter) if emitter.get_shape() is not None]


def recurrence(shift: mi.Point2f, k, sequence=SEQUENCE) -> mi.Point2f:
    """Give point k of the additive recurrence that begins at a point of the unit square."""
    place = shift + mi.Float(k) * mi.Point2f(*sequence)
    return place - dr.floor(place)


def _lattice(leds: Leds, j: int) -> tuple[int, int]:
    shape = leds.emitter[j].get_shape()
    if shape is None:
        return POINT
    return SMOOTH if shape.class_name() in ("Sphere", "Disk", "Rectangle") else MANY


def _lattice_point(k: mi.Float, n: int, step: int) -> mi.Point2f:
    """Give a point of a lattice of n."""
    place = mi.Point2f(k + 0.5, (k + 0.5) * step) / n
    return place - dr.floor(place)
