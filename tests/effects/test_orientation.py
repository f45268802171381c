"""Slopes of a surface have no curl, however noisy; those of a surface that is turned or mirrored do."""

import numpy as np
import pytest

from evsdr.effects.orientation import bends_of, pooled, turn_between
from evsdr.model.view import CameraGeometry

SIZE = 40
FLAT = CameraGeometry(False, (2.3 / SIZE, 2.3 / SIZE), (SIZE / 2, SIZE / 2))
WIDE = CameraGeometry(True, (1.0 / SIZE, 1.0 / SIZE), (SIZE / 2, SIZE / 2))


def turn(deg):
    c, s = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    return np.array([[c, -s], [s, c]])


def ball(camera=FLAT, rng=None, noise=0.0):
    """Give the normals of a ball before a camera, and where it is."""
    ray = camera.points(np.ones((SIZE, SIZE)))
    if camera.perspective:  # a ball of radius 1 at distance 2.5
        ray = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
        middle = np.array([0, 0, -2.5])
        along = ray @ middle
        gap = along**2 - 2.5**2 + 1
        normal = (along - np.sqrt(np.maximum(gap, 0)))[..., None] * ray - middle
        seen = gap > 0.05
    else:
        z2 = 1 - np.sum(ray[..., :2] ** 2, axis=-1)
        normal = np.dstack([ray[..., :2], np.sqrt(np.maximum(z2, 0))])
        seen = z2 > 0.05
    if noise:
        normal = normal + noise * rng.standard_normal(normal.shape)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True), seen


@pytest.mark.parametrize("camera", [FLAT, WIDE])
def test_surfaces_have_no_curl(camera, rng):
    normal, seen = ball(camera, rng, 0.01)
    bends = bends_of(normal, seen, camera)
    assert bends.n > 500 and bends.curl() < 0.03 and bends.least_curl() < bends.curl() + 1e-9


@pytest.mark.parametrize("ring", [turn(15), turn(90), turn(-120), np.diag([-1, 1]), np.diag([1, -1])])
def test_turned_and_mirrored_ones_have(ring, rng):
    normal, seen = ball(rng=rng, noise=0.01)
    turned = np.dstack([normal[..., :2] @ ring.T, normal[..., 2]])
    found = bends_of(turned, seen, FLAT)
    assert found.curl() > 0.09 and found.least_curl() < 0.03
    assert found.curl(ring.T) == pytest.approx(bends_of(normal, seen, FLAT).curl(), abs=1e-3)


def test_half_a_turn_makes_a_bowl():
    normal, seen = ball()
    assert bends_of(normal * [-1, -1, 1], seen, FLAT).curl() < 0.01


def test_an_image_that_is_mirrored():
    """Where it lies otherwise, slopes do not belong together."""
    rows, columns = np.mgrid[:SIZE, :SIZE] / SIZE * 6
    slope = np.dstack([np.cos(columns) * np.sin(2 * rows + 1), -2 * np.sin(columns) * np.cos(2 * rows + 1)])
    normal = np.dstack([-0.3 * slope, np.ones((SIZE, SIZE))])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    everywhere = np.ones((SIZE, SIZE), bool)
    assert bends_of(normal, everywhere, FLAT).curl() < 0.03
    for move in (np.fliplr, np.flipud, lambda a: np.swapaxes(a, 0, 1), np.rot90):
        assert bends_of(move(normal), everywhere, FLAT).curl() > 0.2


def test_noise_has_as_much_however_it_is_turned(rng):
    normal = np.dstack([0.02 * rng.standard_normal((SIZE, SIZE, 2)), np.ones((SIZE, SIZE))])
    bends = bends_of(normal, np.ones((SIZE, SIZE), bool), FLAT)
    assert bends.curl() == pytest.approx(0.5, abs=0.05) and bends.least_curl() > 0.4


def test_nothing_known():
    bends = bends_of(ball()[0], np.zeros((SIZE, SIZE), bool), FLAT)
    assert bends.n == 0 and bends.curl() == 0


def test_blocks_hold_means_over_what_is_known():
    values, known = np.arange(24.0).reshape(4, 6, 1), np.ones((4, 6), bool)
    known[:2, :2], known[0, 2] = False, False
    mean, there = pooled(values, known, 2)
    assert mean.shape == (2, 3, 1) and there.tolist() == [[False, True, True], [True, True, True]]
    assert mean[0, 1, 0] == pytest.approx((3 + 8 + 9) / 3) and mean[1, 2, 0] == pytest.approx(18.5 + 1)


def test_a_turn_between_vectors(rng):
    vectors = rng.standard_normal((50, 2))
    for matrix in (turn(40), np.diag([1.0, -1])):
        found, rigid = turn_between(vectors, vectors @ matrix.T)
        np.testing.assert_allclose(found, matrix, atol=1e-12)
        assert rigid == pytest.approx(1)
    assert turn_between(vectors, rng.standard_normal((50, 2)))[1] < 0.5
