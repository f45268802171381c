"""Directions and irradiances that the ring integrator gives to inverse problems."""

import numpy as np
import pytest
from evsdr.integrators.ring import camera_frame

from tests.support.ring_scenes import (
    HEIGHT,
    LIT_SHARE,
    POWER,
    ROOF,
    SHADOW_EDGE_COLUMN,
    WIDTH,
    ball_normals,
    brute_force,
    camera,
    far,
    load,
    near,
    pixel_centres,
    plane,
    ring,
    soft,
)


def illumination(objects, view=None, spp=1, shadows=True, skip=0.0):
    """Directions (n_led, H, W, 3), irradiances (n_led, H, W) and coverage (H, W)."""
    scene = load(objects, view)
    light, coverage = ring().illumination(scene, scene.sensors()[0], spp, 0, shadows, skip)
    n_pixel = HEIGHT * WIDTH
    direction = np.array([np.broadcast_to(np.array(d, float).T, (n_pixel, 3)) for d in light.direction])
    irradiance = np.array([np.broadcast_to(np.array(e, float), n_pixel) for e in light.irradiance])
    coverage = np.array(coverage, float).reshape(HEIGHT, WIDTH)
    return direction.reshape(-1, HEIGHT, WIDTH, 3), irradiance.reshape(-1, HEIGHT, WIDTH), coverage


def test_far_irradiance_is_power_times_visibility():
    leds = {"led_0": far((-1, 0, 1), 3.0), "led_1": far((1, 2, 1), 0.5)}
    direction, irradiance, coverage = illumination(ROOF | leds, camera(half_width=2.0), spp=64)
    assert np.mean(irradiance[0, :, SHADOW_EDGE_COLUMN]) == pytest.approx(3 * POWER * LIT_SHARE, rel=0.02)
    assert (irradiance[0, :, 10:SHADOW_EDGE_COLUMN] == 0).all()
    np.testing.assert_allclose(irradiance[0, :, SHADOW_EDGE_COLUMN + 1 :], 3 * POWER, rtol=1e-5)
    np.testing.assert_allclose(irradiance[1][coverage > 0], 0.5 * POWER, rtol=1e-5)
    np.testing.assert_allclose(direction[0] - [-1 / np.sqrt(2), 0, 1 / np.sqrt(2)], 0, atol=1e-6)
    # The roof's edge at x = 0.3 lies in the pixel from 0.25 to 0.5.
    assert (coverage[:, :9] == 0).all()
    assert np.mean(coverage[:, 9]) == pytest.approx(0.8, abs=0.02)
    assert (coverage[:, 10:] == 1).all()
    assert (irradiance[:, :, :9] == 0).all()


def test_a_surface_that_turns_away_is_no_shadow():
    """A ball hides no LED from itself; pixels at its horizon are dark in part by their normals alone."""
    leds = {"led_0": far((1, 0.2, 0.3), 3.0), "led_1": near((-2, 1, 1.5))}
    objects = {"object": {"type": "sphere"}} | leds
    lit, free = (illumination(objects, spp=64, shadows=shadows) for shadows in (True, False))
    inside = lit[2] == 1
    np.testing.assert_allclose(lit[1][:, inside], free[1][:, inside], rtol=1e-4)


def test_light_of_a_pixel_that_turns_away_in_part_is_that_of_its_lit_part():
    """Irradiance times the mean of max(0, n . l) over a pixel is what a render of it shows."""
    objects = {"object": {"type": "sphere"}, "led_0": far((1, 0, 0.3), 3.0), "led_1": far((0, 0, 1), 1.0)}
    pole = {"type": "cylinder", "p0": [1.5, 0.3, 0.5], "p1": [1.5, -0.3, 0.5], "radius": 0.2}
    scene, alone = load(objects | {"pole": pole}), load(objects)
    signal, bare = (
        np.array(ring().signals(s, s.sensors()[0], 256)[0]).reshape(HEIGHT, WIDTH) for s in (scene, alone)
    )
    light, coverage = ring().illumination(scene, scene.sensors()[0], 256)
    share = np.array(light.irradiance[0]).reshape(HEIGHT, WIDTH) / (3 * POWER)
    some = (np.array(coverage).reshape(HEIGHT, WIDTH) == 1) & (bare > 0.02 * bare.max())
    assert (share[some] < 0.9).any()
    np.testing.assert_allclose((share * bare)[some], signal[some], atol=0.02 * bare.max())


def test_shadows_can_be_left_out():
    leds = {"led_0": far((-1, 0, 1), 3.0), "led_1": near((-3, 0, 6))}
    objects, view = ROOF | leds, camera(half_width=2.0)
    with_shadow = illumination(objects, view, spp=16)[1]
    without = illumination(objects, view, spp=16, shadows=False)[1]
    np.testing.assert_allclose(without[0], 3 * POWER, rtol=1e-5)
    assert (without[:, :, 10:] > 0).all()
    assert (with_shadow[1, :, 10] == 0).all()
    np.testing.assert_allclose(with_shadow[1, :, 15], without[1, :, 15], rtol=1e-5)


def test_near_direction_and_irradiance():
    position = np.array([0.3, -0.2, 1.5])
    x, y = pixel_centres()
    to_light = position - np.stack([x, y, np.zeros_like(x)], axis=-1)
    distance = np.linalg.norm(to_light, axis=-1)
    objects = {"object": plane(), "led_0": near(position), "led_1": near((0, 0, 1))}
    direction, irradiance, _ = illumination(objects)
    np.testing.assert_allclose(direction[0], to_light / distance[..., None], atol=1e-5)
    np.testing.assert_allclose(irradiance[0], POWER / distance**2, rtol=1e-5)


def test_soft_direction_and_irradiance_against_brute_force():
    position, half_width = (-2.0, 0.4, 2.0), 0.4
    objects = {"object": plane(), "led_0": soft(position, half_width), "led_1": far((0, 0, 1))}
    direction, irradiance, _ = illumination(objects)
    x, y = pixel_centres()
    for row, column in [(0, 0), (6, 8), (11, 15)]:
        _, to_light, given = brute_force(np.array([x[row, column], y[row, column], 0]), position, half_width)
        mean = given @ to_light
        expected = mean / np.linalg.norm(mean)
        np.testing.assert_allclose(direction[0, row, column], expected, atol=1e-3)
        assert irradiance[0, row, column] == pytest.approx(POWER * np.linalg.norm(mean), rel=2e-3)


def test_directions_turn_with_the_camera():
    origin, up, position = np.array([4.0, 2.0, 8.0]), np.array([0.2, 1.0, 0.1]), np.array([1.0, -2.0, 3.0])
    toward_camera = origin / np.linalg.norm(origin)
    right = np.cross(up, toward_camera)
    right /= np.linalg.norm(right)
    frame = np.array([right, np.cross(toward_camera, right), toward_camera])
    view = camera(origin, up)
    objects = {"object": {"type": "sphere"}, "led_0": far(position), "led_1": near(position)}
    np.testing.assert_allclose(camera_frame(load(objects, view).sensors()[0]), frame, atol=1e-6)

    direction, _, coverage = illumination(objects, view, shadows=False)
    np.testing.assert_allclose(direction[0, 0, 0], frame @ position / np.linalg.norm(position), atol=1e-6)
    normal, on_ball = ball_normals()
    to_light = frame @ position - normal
    to_light /= np.linalg.norm(to_light, axis=-1, keepdims=True)
    np.testing.assert_array_equal(coverage == 1, on_ball)
    np.testing.assert_allclose(direction[1][on_ball], to_light[on_ball], atol=1e-4)


def test_occluders_that_are_near_do_not_count():
    """A roof 0.15 above the floor; a plate 0.1 behind a near LED, or well before it; the LED's own shape."""
    roof, plate = plane(at=(0, 0, 0.15), half_width=(9, 9, 1)), plane(at=(0, 0, 1.1), half_width=(9, 9, 1))
    view = camera((0, 0, 0.1))
    for objects, skip, lit in (
        ({"roof": roof, "led_0": far((0, 0, 1))}, 0.0, False),
        ({"roof": roof, "led_0": far((0.3, 0, 1))}, 0.3, True),
        ({"plate": plate, "led_0": near((0, 0, 1))}, 0.3, True),
        ({"plate": plate, "led_0": near((0, 0, 2))}, 0.3, False),
        ({"led_0": soft((1, 0, 4), 0.3)}, 0.3, True),
    ):
        _, irradiance, _ = illumination(
            {"object": plane()} | objects | {"led_1": far((0, 0, 1))}, view, skip=skip
        )
        assert (irradiance[0] > 0).all() if lit else (irradiance[0] == 0).all()


def test_spread_of_the_widest_led():
    """Squares 0.8 and 0.2 wide, 5 and 2 from the object's middle; a lamp that is no LED does not count."""
    leds = {"led_0": soft((3, 0, 4), 0.4), "led_1": soft((0, 0, 2), 0.1), "lamp": soft((0, 0, 3), 2.0)}
    scene = load({"object": plane()} | leds)
    light, _ = ring().illumination(scene, scene.sensors()[0], 1)
    assert light.spread == pytest.approx(0.8 / 12**0.5 / 5, rel=0.01)
