"""Light by way of other surfaces against a sum over a wall; pixels that see points."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from evsdr.integrators.gather import Surface, gather, pixel_finder
from evsdr.integrators.leds import find_leds
from evsdr.integrators.ring import find_object

from evsdr.model.view import CameraGeometry, View, pixel_centers
from tests.support.ring_scenes import POWER, far, load, plane

X = np.linspace(-0.9, 0.9, 7)  # places on the floor


def corner(wall_reflectance, extra=None):
    """A floor z = 0 that looks up beside a wall x = -1 that looks to +x, 2 high and 8 long."""
    wall = plane(wall_reflectance, 90.0, at=(-1, 0, 1), half_width=(1, 4, 1))
    leds = {"led_0": far((1, 0, 1e-3)), "led_1": far((0, 0, 1), 2.0)}
    return load({"object": plane(half_width=(1, 4, 1)), "wall": wall} | leds | (extra or {}))


def gathered(scene, known=True, normal=(0, 0, 1), signal=0.0, pixel_size=0.1, n_ray=512, skip=0.0):
    """Irradiance (n_led, n) at points of the floor; all that is seen of the object is seen by pixel 0."""
    n = len(X)
    place = scene.ray_intersect(mi.Ray3f(mi.Point3f(X.astype(np.float32), 0, 0.5), mi.Vector3f(0, 0, -1)))
    surface = Surface(
        shape=find_object(scene),
        place=place,
        normal=dr.normalize(mi.Vector3f(*normal)) + dr.zeros(mi.Vector3f, n),
        reflectance=[dr.full(mi.Float, 0.3, n)],
        known=mi.Bool([known] * n),
        pixel_of=lambda point: (
            dr.zeros(mi.UInt32, dr.width(point)),
            dr.full(mi.Bool, True, dr.width(point)),
        ),
        pixel_size=pixel_size,
    )
    sent = gather(scene, find_leds(scene), surface, [dr.full(mi.Float, signal, n)] * 2, n_ray, 0, skip)
    return np.array([e.numpy() for e in sent])


def test_a_lit_wall_lights_the_floor_as_its_points_do():
    """INT B cos cos' / (pi r^2) dA over the wall, whose signal is B = 0.6 of the LED's power."""
    z, y = np.meshgrid((np.arange(400) + 0.5) / 200, ((np.arange(800) + 0.5) / 100) - 4)
    expected = []
    for x in X:
        r2 = (x + 1) ** 2 + y**2 + z**2
        expected.append(0.6 * POWER * np.sum(z * (x + 1) / (np.pi * r2**2)) * (1 / 200) * (1 / 100))
    found = gathered(corner(0.6))
    np.testing.assert_allclose(found[0], expected, rtol=0.06, atol=0.004 * POWER)
    assert expected[0] > 3 * expected[-1] > 0
    np.testing.assert_array_equal(found[1], 0)  # that LED grazes the wall


def test_what_hides_the_light_from_the_wall_darkens_the_floor():
    curtain = {"curtain": plane(0.0, 90.0, at=(3, 0, 1), half_width=(9, 9, 1))}
    assert gathered(corner(0.6))[0].min() > 0
    np.testing.assert_array_equal(gathered(corner(0.6, curtain)), 0)


def test_unknown_pixels_gather_nothing():
    np.testing.assert_array_equal(gathered(corner(0.6), known=False), 0)


def test_the_walls_own_colour_counts():
    """A wall twice as bright sends twice the light."""
    dim, bright = (gathered(corner(r))[0] for r in (0.3, 0.6))
    np.testing.assert_allclose(bright, 2 * dim, rtol=1e-5)


def test_the_object_sends_what_its_pixels_show_and_where_hidden_what_the_mean_pixel_would():
    """The wall is the object: seen where pixels are large, else of the mean reflectance 0.3."""
    other = gathered(corner(0.6), n_ray=64)[0]
    leds = {"led_0": far((1, 0, 1e-3)), "led_1": far((0, 0, 1), 2.0)}
    wall = plane(0.9, 90.0, at=(-1, 0, 1), half_width=(1, 4, 1))
    scene = load({"floor": plane(half_width=(1, 4, 1)), "object": wall} | leds)
    hidden = gathered(scene, signal=7.0, pixel_size=1e-3, n_ray=64)[0]
    np.testing.assert_allclose(hidden, 0.3 / 0.6 * other, rtol=1e-5)
    seen = gathered(scene, signal=7.0, pixel_size=1e3, n_ray=64)
    np.testing.assert_allclose(seen[0], 7.0 / (0.6 * POWER) * other, rtol=1e-3)
    np.testing.assert_array_equal(seen[0], seen[1])


def test_nothing_comes_from_below_the_geometry():
    """A fitted normal that lies nearly in the floor looks at a lit wall in the cellar, too."""
    wall = plane(0.9, -90.0, at=(1.5, 0, -2), half_width=(1.9, 9, 1))
    leds = {"led_0": far((-1, 0, -0.2)), "led_1": far((0, 0, 1))}
    scene = load({"object": plane(half_width=(1, 4, 1)), "wall": wall} | leds)
    from_below = scene.ray_intersect(mi.Ray3f(mi.Point3f(0, 0, -1), mi.Vector3f(1, 0, 0)))
    assert float(from_below.p.x[0]) == pytest.approx(1.5)
    np.testing.assert_array_equal(gathered(scene, normal=(1, 0, 0.05)), 0)


def test_what_is_hit_at_once_is_the_surface_itself():
    near, far_off = (gathered(corner(0.6), skip=skip)[0] for skip in (0.0, 9.0))
    assert near.min() > 0 and far_off.max() == 0


@pytest.mark.parametrize("perspective", [False, True])
def test_the_pixel_that_sees_a_point(perspective, rng):
    camera = CameraGeometry(perspective, (0.1, 0.08), (4.5, 3.0))
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    frame *= np.linalg.det(frame)
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = frame.T, [1, 2, 3]
    view = View(camera, frame, to_world[:3, 3])
    pixel = pixel_centers(np.ones((6, 9), bool)) + rng.uniform(-0.4, 0.4, (54, 2))
    origin, direction = view.rays(np.concatenate([pixel, [[-0.5, 2], [9.5, 2], [4, -0.5], [4, 6.5]]]))
    point = view.point_to_world(origin + 5 * direction)
    find = pixel_finder(9, 6, camera.pixel_size, camera.center, perspective, to_world)
    found, inside = find(mi.Point3f(point.T.astype(np.float32)))
    np.testing.assert_array_equal(found.numpy()[:54], np.arange(54))
    np.testing.assert_array_equal(inside.numpy(), np.arange(58) < 54)
