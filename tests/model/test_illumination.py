"""The horizon of curved pixels and wide LEDs by brute force; light of some pixels."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.illumination import HARD, OF_SPREAD, Illumination, pixel_horizon
from evsdr.model.lambert import soft_max0
from evsdr.solve.grid import make_grid


def test_light_of_some_pixels(rng):
    """What differs between pixels is picked, what is the same everywhere stays as it is."""
    direction, irradiance = rng.normal(size=(3, 7)).astype(np.float32), rng.random(7).astype(np.float32)
    light = Illumination(
        [mi.Vector3f(0, 0, 1), mi.Vector3f(direction)],
        [mi.Float(irradiance), mi.Float(0.5)],
        [1, 0],
        mi.Float(0.05),
        [mi.Float(irradiance + 1), mi.Float(0.0)],
        0.1,
    )
    some = np.array([6, 0, 3], np.uint32)
    few = light.gather(mi.UInt32(some))
    np.testing.assert_array_equal(few.direction[1].numpy(), direction[:, some])
    np.testing.assert_array_equal(few.irradiance[0].numpy(), irradiance[some])
    np.testing.assert_array_equal(few.indirect[0].numpy(), irradiance[some] + 1)
    assert [dr.width(v) for v in (few.direction[0], few.irradiance[1], few.indirect[1])] == [1, 1, 1]
    assert (few.band, few.spread, few.n_led, few.n_band) == ([1, 0], 0.1, 2, 2)


def test_light_that_is_seen_in_part():
    """Shares go into the irradiance, and come out of it again; what is brighter than the whole is seen."""
    up = [mi.Vector3f(0, 0, 1)] * 2
    whole = Illumination(up, [mi.Float([2.0, 3.0, 0.0]), mi.Float(0.5)], [0, 1], mi.Float(0.05))
    share = np.float32([[0.5, 0, 0.25], [1, 0.2, 0]])
    part = whole.seen(share)
    np.testing.assert_allclose(part.irradiance[0].numpy(), [1, 0, 0])
    np.testing.assert_allclose(part.irradiance[1].numpy(), [0.5, 0.1, 0])
    again = part.share_of(whole, 3)
    share[0, 2] = 1  # an LED that gives nothing hides nothing
    np.testing.assert_allclose(again, share)
    assert whole.share_of(part, 3).max() == 1 and again.dtype == np.float32


def test_the_pixel_horizon_is_the_mean_over_a_curved_pixel():
    """A cylinder lit at grazing angle: max(0, n . l) averaged over each pixel, by many samples."""
    size, radius, light = 16, 12.0, np.radians(60)  # pixels
    grid = make_grid(np.ones((3, size), bool), mi.UInt32).links
    hard, soft = [], []
    for shift in np.linspace(0, 1, 11):
        x = (np.arange(size * 50) + 0.5) / 50 - size / 2 + shift
        tilt = np.arcsin(x / radius)
        fine = np.maximum(np.cos(tilt + light), 0).reshape(size, 50).mean(axis=1)
        middle = tilt.reshape(size, 50).mean(axis=1)
        slope = mi.Float(np.tile(np.tan(-middle), 3).astype(np.float32))
        softness = pixel_horizon(slope, dr.zeros(mi.Float, 3 * size), grid)
        cosine = np.cos(middle + light)
        softened = soft_max0(mi.Float(np.tile(cosine, 3).astype(np.float32)), softness).numpy()[
            size : 2 * size
        ]
        near = np.abs(cosine) < 0.1
        hard += list((np.maximum(cosine, 0) - fine)[near])
        soft += list((softened - fine)[near])
    assert np.std(soft) < 0.6 * np.std(hard)


def test_the_pixel_horizon_knows_how_fast_normals_turn(rng):
    """The mean of max(0, x) for normal x of variance g^2 / 24; from one neighbour g is the difference to it."""
    mask = np.array([[1, 1, 1, 0], [1, 1, 0, 0], [1, 0, 0, 1]], bool)
    slopes = rng.normal(0, 0.5, (2, *mask.shape))
    normal = np.stack([-slopes[0], -slopes[1], np.ones(mask.shape)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    square = np.zeros(mask.shape)
    for (row, column), inside in np.ndenumerate(mask):
        for step in ((0, 1), (1, 0)) if inside else ():
            ends = [(row + s * step[0], column + s * step[1]) for s in (-1, 1)]
            ends = [e for e in ends if 0 <= e[0] < 3 and 0 <= e[1] < 4 and mask[e]]
            if ends:
                first, last = ends if len(ends) == 2 else (ends[0], (row, column))
                square[row, column] += np.sum((normal[last] - normal[first]) ** 2) / len(ends) ** 2
    found = pixel_horizon(
        *(mi.Float(s[mask].astype(np.float32)) for s in slopes), make_grid(mask, mi.UInt32).links
    )
    np.testing.assert_allclose(found.numpy(), OF_SPREAD * np.sqrt(square[mask] / 24), atol=1e-5)
    assert found.numpy()[-1] == 0 and OF_SPREAD == pytest.approx(2 / np.sqrt(2 * np.pi), rel=0.01)


def test_an_led_with_a_surface_sets_slowly(rng):
    """Near the horizon: max(0, n . l) averaged over a square LED by brute force, and by its softness."""
    spread = 0.2 / 3**0.5 / 3.5  # of a square 0.4 wide at 3.5
    light = Illumination([mi.Vector3f(0, 0, 1)], [mi.Float(1)], [0], mi.Float(0.05), spread=spread)
    point = np.array([3.5, 0, 0]) + np.r_[0, 1, 1] * rng.uniform(-0.2, 0.2, (200_000, 3))
    direction = point / np.linalg.norm(point, axis=1, keepdims=True)
    for elevation in np.linspace(-0.06, 0.06, 9):
        normal = np.array([np.sin(elevation), np.cos(elevation), 0])
        wanted = np.maximum(direction @ normal, 0).mean()
        softened = float(soft_max0(mi.Float(np.sin(elevation)), mi.Float(light.horizon))[0])
        assert softened == pytest.approx(wanted, abs=0.1 * spread)
    assert Illumination([], [], [0], mi.Float(0.05)).horizon == HARD
