"""Scenes told in another unit look the same: shadows of small things count."""

import numpy as np
import pytest
from evsdr.integrators.pixels import pixel_mean
from evsdr.integrators.rays import fineness

from tests.support.ring_scenes import camera, far, load, near, plane, render, soft

UNITS = [1e-6, 1e6]


def scene(unit):
    """A plane with a card above it, lit by a far, a near and a square LED."""
    card = plane(at=(0.3 * unit, 0, 0.2 * unit), half_width=(0.2 * unit, 0.2 * unit, 1))
    return load(
        {
            "camera": camera((0, 0, 4 * unit), half_width=unit)
            | {"near_clip": 0.1 * unit, "far_clip": 10 * unit},
            "object": plane(half_width=(2 * unit, 2 * unit, 1)),
            "card": card,
            "led_0": far((1, 0, 1)),
            "led_1": near((-2 * unit, unit, 2 * unit), unit**2),
            "led_2": soft((unit, unit, 2 * unit), 0.1 * unit),
        }
    )


@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_of_a_scene_does_not_matter(unit):
    image, expected = (render(scene(u), spp=4) for u in (unit, 2.0))
    different = np.abs(image - expected).max(axis=2) > 1e-3 * expected.max()
    assert np.count_nonzero(different) <= 2  # an edge on a ray
    assert (expected[..., 0] < 0.9 * expected[..., 0].max()).sum() > 5  # the card's shadow
    image, expected = (render(scene(u), max_depth=2, spp=4).mean(axis=(0, 1)) for u in (unit, 2.0))
    np.testing.assert_allclose(image, expected, rtol=0.01)


def test_usual_scenes_are_traced_as_before():
    assert fineness(scene(1.0)) is None
    assert fineness(scene(1e-3))[0] == pytest.approx(2e-3, rel=0.1)


def test_points_of_a_pixel_are_the_same_whatever_is_asked_there():
    """Light and the truth about the surface are means over the same points, though paths need random numbers."""
    given = scene(1.0)

    def mean_place(used):
        def measure(s, si, ray, rng, active):
            for _ in range(used):
                rng.next_float32()
            return [si.p.x, si.p.y]

        return np.array(pixel_mean(given, given.sensors()[0], 8, 3, 2, measure))

    np.testing.assert_array_equal(mean_place(0), mean_place(3))
