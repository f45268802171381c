"""Pairs of neighbours: what planes and spheres tell of them, and whom a pixel believes."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.model.view import CameraGeometry
from evsdr.shape.bilateral import (
    CREASE_DEG,
    LEAST_WEIGHT,
    SHARPNESS,
    SIGMA_EVEN_DEG,
    STEEPNESS,
    Pairs,
    believed_sides,
    even_sides,
    facing,
    least_squares,
    lines_of_sight,
    make_pairs,
    tied,
)

SHAPE = 5, 6
CAMERAS = [CameraGeometry(False, (0.1, 0.1), (3.0, 2.5)), CameraGeometry(True, (0.02, 0.02), (3.0, 2.5))]


def of_plane(camera, normal, distance):
    """Depth, or log depth, of normal . P = -distance."""
    depth = -distance / np.sum(np.array(normal) * lines_of_sight(camera, SHAPE), axis=-1)
    if camera.perspective:
        return np.log(depth)
    return depth + (camera.points(np.zeros(SHAPE))[..., :2] @ normal[:2]) / normal[2]


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("axis", [0, 1])
def test_a_plane_tells_its_depth(camera, axis):
    """By either side and by both, whatever is trusted; the reach is what a pixel off the plane is off it."""
    normal = np.array([0.3, -0.5, 0.8]) / np.sqrt(0.98)
    value = of_plane(camera, normal, 5.0)
    image, mask = np.broadcast_to(normal, (*SHAPE, 3)), np.ones(SHAPE, bool)
    pairs = make_pairs(image, mask, np.arange(30.0).reshape(SHAPE), camera, axis)
    for told in (*pairs.plane, pairs.chord):
        np.testing.assert_allclose(told, np.diff(value, axis=axis), atol=1e-12)
    step = 1e-6
    depth = np.exp(value) if camera.perspective else value
    moved = camera.points(np.exp(value + step) if camera.perspective else value + step)
    still = camera.points(depth)
    off = (
        np.abs((moved - still) @ normal) / step / camera.pixel_size[0] / (depth if camera.perspective else 1)
    )
    one, other = np.delete(off, -1, axis), np.delete(off, 0, axis)
    np.testing.assert_allclose(pairs.reach[0], one, rtol=1e-4)
    np.testing.assert_allclose(pairs.reach[1], other, rtol=1e-4)
    np.testing.assert_allclose(pairs.chord_reach, one, rtol=1e-4)


def test_a_sphere_tells_its_depth_by_chords():
    camera = CAMERAS[0]
    x, y, _ = np.moveaxis(camera.points(np.ones(SHAPE)), -1, 0)
    height = np.sqrt(1 - x**2 - y**2)
    pairs = make_pairs(np.stack([x, y, height], axis=-1), np.ones(SHAPE, bool), np.ones(SHAPE), camera, 1)
    np.testing.assert_allclose(pairs.chord, -np.diff(height, axis=1), atol=1e-12)
    assert np.abs(pairs.plane[0] + np.diff(height, axis=1)).max() > 1e-3


def test_creases_are_not_smooth():
    """Normals that differ by 20 degrees count 1 / e."""
    normal = np.broadcast_to([0.0, 0, 1], (*SHAPE, 3)).copy()
    normal[2, 2] = [np.sin(np.radians(CREASE_DEG)), 0, np.cos(np.radians(CREASE_DEG))]
    smooth = make_pairs(normal, np.ones(SHAPE, bool), np.ones(SHAPE), CAMERAS[0], 0).smooth
    np.testing.assert_allclose(smooth[1:3, 2], np.exp(-1))
    assert (np.delete(smooth, 2, axis=1) == 1).all()


def test_who_is_not_known_is_not_trusted():
    camera, mask = CAMERAS[0], np.ones(SHAPE, bool)
    mask[0, 0] = False
    sigma = np.zeros(SHAPE)
    sigma[2, 2] = SIGMA_EVEN_DEG
    normal = np.broadcast_to([0.0, 0, 1], (*SHAPE, 3)).copy()
    normal[2, 2] = [0.6, 0, 0.8]
    pairs = make_pairs(normal, mask, sigma, camera, 1)
    assert pairs.trust[0][2, 2] == 0.5 and pairs.trust[1][2, 2] == 1 and pairs.trust[1][2, 1] == 0.5
    assert not pairs.joined[0, 0] and pairs.joined.sum() == pairs.joined.size - 1
    np.testing.assert_allclose(pairs.chord[2, 2], 0.1 * 0.3 / 1.4)  # of normals that count 1 and 1/2


def make(difference, value_shape=(1, 4)):
    shape = value_shape[0], value_shape[1] - 1
    one = np.ones(shape)
    return Pairs(one > 0, (difference, difference), difference, (one, one), one, 0 * one, (one, one))


def test_each_pixel_believes_the_side_that_reaches_less_far():
    """Heights 0, 0.5, 3.5, 3.7: the sigmoids by hand; at the border, what is not there reaches 0."""
    value = np.array([[0.0, 0.5, 3.5, 3.7]])
    first, second = believed_sides(make(np.zeros((1, 3))), value, 1)
    squares = np.array([0, 0.25, 9, 0.04, 0])
    weight = 1 / (1 + np.exp(SHARPNESS * (squares[1:] - squares[:-1])))
    np.testing.assert_allclose(first[0], weight[:-1])
    np.testing.assert_allclose(second[0], 1 - weight[1:])
    assert first[0, 1] < 1e-9 and second[0, 1] < 1e-9 and first[0, 2] > 0.99


def test_who_is_not_trusted_takes_no_side():
    """The second pixel of four."""
    value, pairs = np.array([[0.0, 0.5, 3.5, 3.7]]), make(np.zeros((1, 3)))
    pairs = replace(pairs, trust=(np.array([[1.0, 0, 1]]), np.array([[0.0, 1, 1]])))
    first, second = believed_sides(pairs, value, 1)
    assert first[0, 1] == second[0, 0] == 0.5 and second[0, 1] < 1e-9


def test_where_both_sides_count_alike_the_chord_does(rng):
    """And where the surface is smooth; else the believed plane."""
    one = np.ones((1, 3))
    planes = rng.normal(size=(1, 3)), rng.normal(size=(1, 3))
    pairs = Pairs(one > 0, planes, rng.normal(size=(1, 3)), (2 * one, one), one, 0 * one, (one, 0.5 * one))
    weight, difference = least_squares(pairs, even_sides(pairs))
    np.testing.assert_allclose(difference, pairs.chord)
    np.testing.assert_allclose(weight, 0.5 * 2.0**STEEPNESS + 0.25)
    weight, difference = least_squares(pairs, (one, 0 * one))
    np.testing.assert_allclose(difference, planes[0], atol=1e-5)
    _, difference = least_squares(replace(pairs, smooth=0.7 * one), (one, 0 * one))
    np.testing.assert_allclose(difference, 0.3 * planes[0] + 0.7 * pairs.chord, atol=1e-5)
    weight, _ = least_squares(pairs, (0 * one, 0 * one))
    np.testing.assert_allclose(weight, LEAST_WEIGHT * (2.0**STEEPNESS + 1))


def test_tied_up_to_a_pixel():
    pairs = make(np.array([[0.5, 0.5, -0.5]]))
    value = np.cumsum([[0, 0.5 + 0.99, 0.5 + 1.01, -0.5 - 1.01]], axis=1)
    np.testing.assert_array_equal(tied(pairs, value, 1), [[True, False, False]])


def test_normals_face_the_camera():
    """Those from behind become as steep as may be; others stay."""
    sight = np.array([[0.0, 0, -1], [0, 0, -1], [0.6, 0, -1]])
    turned = facing(np.array([[3.0, 0, -4], [0, 0, 2], [3.0, 0, 3]]), sight)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1)
    np.testing.assert_allclose(turned[0], [np.sqrt(1 - 0.05**2), 0, 0.05])
    np.testing.assert_allclose(turned[1:], [[0, 0, 1], [np.sqrt(0.5), 0, np.sqrt(0.5)]])
