"""Pixels are areas: rays through random points of each, the same whatever is measured along them."""

import drjit as dr
import mitsuba as mi
import numpy as np

SEQUENCE_OF_PLACES, SEQUENCE_OF_SHIFTS, SEQUENCE_OF_PATHS = 0xDA3E39CB94B95BDB, 7, 8  # of random numbers


def pixel_mean(scene, sensor, spp, seed, n_value, measure, n_copy=1) -> list[mi.Float]:
    """Average a quantity over the area of each pixel.

    Parameters
    ----------
    n_copy : int
        Lanes of a pixel. All see the same points; `measure` may ask each for something else, and a kernel for many LEDs is
        as short as that for one.
    measure : callable (s, si, ray, rng, active) -> list of mi.Float
        What to average, of length n_value, from the first surface point that ray s of a pixel meets. These points depend
        on the seed alone, however many random numbers of `rng` are used from there.

    Returns
    -------
    list of mi.Float, (n_value) of width n_copy * H * W
        All pixels of the first copy come first.
    """
    width, height = (int(n) for n in sensor.film().crop_size())
    pixel = _pixels(width * height, n_copy)
    corner = mi.Vector2f(mi.Float(pixel % width), mi.Float(pixel // width))
    seed = mi.UInt64(seed)
    dr.make_opaque(seed)  # else each seed would be a kernel of its own
    places = _generator(seed, SEQUENCE_OF_PLACES, pixel)
    # Sequences whose numbers differ by the same in all pixels are not independent: these are scrambled
    state, sequence = mi.sample_tea_32(pixel, mi.UInt32(seed) + SEQUENCE_OF_PATHS)
    paths = _generator(mi.UInt64(state), mi.UInt64(sequence), pixel)
    grid = int(np.sqrt(spp))
    stratified = grid * grid == spp

    def one(s, places, paths):
        if spp == 1:
            offset = mi.Point2f(0.5)
        else:
            offset = mi.Point2f(places.next_float32(), places.next_float32())
            if stratified:
                offset = (offset + mi.Point2f(mi.Float(s % grid), mi.Float(s // grid))) / grid
        position = (corner + offset) / mi.Vector2f(width, height)
        ray, _ = sensor.sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
        si = scene.ray_intersect(ray, mi.RayFlags.All, coherent=True)
        return measure(s, si, ray, paths, mi.Bool(True))

    if spp == 1:
        return one(mi.UInt32(0), places, paths)

    def body(s, places, paths, *total):
        value = one(s, places, paths)
        return (s + 1, places, paths, *(t + v for t, v in zip(total, value)))

    zero = [dr.zeros(mi.Float, n_copy * width * height) for _ in range(n_value)]
    start = mi.UInt32(0), places, paths, *zero
    state = dr.while_loop(start, lambda s, *_: s < spp, body, label="pixel samples", max_iterations=-1)
    return [total / spp for total in state[3:]]


def pixel_shift(sensor, seed, n_copy=1) -> mi.Point2f:
    """Give a random point of the unit square for each pixel, from which samples of LEDs go on, ray by ray."""
    seed = mi.UInt64(seed)
    dr.make_opaque(seed)
    rng = _generator(seed, SEQUENCE_OF_SHIFTS, _pixels(int(dr.prod(sensor.film().crop_size())), n_copy))
    return mi.Point2f(rng.next_float32(), rng.next_float32())


def _pixels(n_pixel: int, n_copy: int) -> mi.UInt32:
    """Number the pixels, copy after copy."""
    return dr.arange(mi.UInt32, n_copy * n_pixel) % n_pixel


def _generator(state: mi.UInt64, sequence, pixel: mi.UInt32) -> mi.PCG32:
    """Make random numbers that each pixel has for itself, and all its copies alike."""
    return mi.PCG32(initstate=state + mi.UInt64(pixel), initseq=sequence + mi.UInt64(pixel))
