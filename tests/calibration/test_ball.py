"""LED directions and positions from a matt ball."""

import numpy as np
import pytest

from evsdr.calibration.ball import (
    ball_pixels,
    ball_surface,
    firing_mask,
    fit_outline,
    place_ball,
    solve_far,
    solve_near,
)
from evsdr.calibration.watched import watch
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.metrics import angular_error_deg
from evsdr.model.view import CameraGeometry, View, pixel_centers
from evsdr.records import Events, Recording, Schedule, Sensor
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals
from tests.support.balls import LIGHT, OUTLINE, PIXEL, SIZE, average, camera, moved_directions
from tests.support.event_reference import find_events, light_path


def solve(view, recording, mask=None):
    count = np.zeros((recording.sensor.height, recording.sensor.width), int)
    np.add.at(count, (recording.events.y, recording.events.x), 1)
    outline = fit_outline(view, firing_mask(count) if mask is None else mask)
    chosen = ball_pixels(view, outline, count.shape, 0)
    part = watch(recording, chosen, np.cumsum(chosen).reshape(count.shape) - 1, 12_000, 0)
    n_led = int(recording.schedule.order.max()) + 1
    return solve_far(view, part, pixel_centers(chosen), outline, ring_directions(n_led), 10.0)


def test_directions_within_a_fifth_of_a_degree_and_their_sigma(rng):
    """A ball with LEDs off the ring and of unequal power, seen by pixels of an EVK4 of finite size."""
    size = 24
    truth, power = moved_directions(rng), rng.uniform(0.7, 1.3, 24)
    normal, mask = sphere_normals(4 * size)
    signal = average(
        lambert_signals(normal, np.full((*mask.shape, 1), 0.6), truth) * mask * power[:, None, None], 4
    )
    schedule = Schedule(np.arange(24, dtype=np.int32), 20_000.0, 1.0)
    events, on, off, starts = simulate_events(signal, LIGHT, schedule, 2, EventPixel(), 1)
    recording = Recording(events, Sensor(size, size, on, off, 52.0), schedule, starts)
    found = solve(camera(size), recording)
    error = angular_error_deg(found.direction, truth)
    assert error.max() < 0.25
    # 0.4 to 1.3 over five draws: all LEDs lean together with the outline of the ball
    assert 0.3 < np.sqrt(np.mean((error / found.sigma_deg) ** 2)) < 1.4
    np.testing.assert_allclose(found.outline, OUTLINE * size / SIZE, atol=0.05)
    relative = power / power.mean()
    assert np.sqrt(np.mean(((found.strength - relative) / found.strength_sigma) ** 2)) < 1.4
    np.testing.assert_allclose(
        found.constant_light, LIGHT / (0.6 * power.mean()), rtol=0.03
    )  # 1.5 to 2.1 % high over five draws


def test_events_of_an_independent_simulator(rng):
    """The brute-force event pixel of the tests, eight LEDs, hardly any noise."""
    size, n_led, slot_us = 20, 8, 2000.0
    view, order = camera(size), np.arange(n_led)
    truth = ring_directions(n_led) + rng.normal(0, 0.06, (n_led, 3))
    truth /= np.linalg.norm(truth, axis=1, keepdims=True)
    normal, mask = sphere_normals(4 * size)
    signal = average(lambert_signals(normal, np.full((*mask.shape, 1), 0.6), truth) * mask, 4).reshape(
        n_led, -1
    )
    t = np.arange(0, 2 * n_led * slot_us + 5, 10.0)
    path = np.log(light_path(t, signal, LIGHT, order, slot_us, 1.0))
    columns = []
    for k in range(size * size):
        times, polarity = find_events(t, path[:, k], 0.2, 0.25, 20.0)
        columns += [(time, k, p > 0) for time, p in zip(times, polarity)]
    t_us, pixel, p = np.array(sorted(columns)).T
    y, x = np.divmod(pixel.astype(int), size)
    events = Events(
        x.astype(np.uint16), y.astype(np.uint16), p.astype(np.int8), np.rint(t_us).astype(np.int64)
    )
    starts = np.array([0, 1, 2]) * int(n_led * slot_us)
    schedule = Schedule(order.astype(np.int32), slot_us, 1.0)
    found = solve(view, Recording(events, Sensor(size, size, 0.2, 0.25, 20.0), schedule, starts))
    assert angular_error_deg(found.direction, truth).max() < 0.3


@pytest.mark.parametrize("perspective", [False, True])
def test_outline_of_a_rendered_ball(perspective):
    """A mask drawn from the ball's own geometry, off the optical axis."""
    view, radius, center = camera(200), 0.4, np.array([0.35, -0.3, -10.0])
    if perspective:
        view = View(CameraGeometry(True, (0.006, 0.006), (100, 100)), np.eye(3), np.zeros(3))
        radius, center = 0.9, np.array([0.35, -0.3, -3.0])
    origin, d = view.rays(pixel_centers(np.ones((200, 200), bool)))
    offset = center - origin
    along = np.sum(offset * d, axis=1)
    mask = (np.sum(offset**2, axis=1) - along**2 < radius**2).reshape(200, 200)
    outline = fit_outline(view, mask)
    found, size = place_ball(view, outline, radius, 10.0)
    np.testing.assert_allclose(found[:2] / found[2], center[:2] / center[2], atol=1e-3)
    assert found[2] == pytest.approx(center[2], rel=0.003)
    assert size == pytest.approx(radius, abs=0.002)


def test_near_leds(rng):
    """Positions of point LEDs at 3 to 4 radii, with perspective."""
    size, n_led, radius = 24, 8, 1.0
    width = 2.5 / 8 / size
    view = View(CameraGeometry(True, (width, width), (size / 2, size / 2)), np.eye(3), np.zeros(3))
    center = np.array([0.0, 0.0, -8.0])
    place = center + ring_directions(n_led) * rng.uniform(3, 4, (n_led, 1))
    pixel = pixel_centers(np.ones((4 * size, 4 * size), bool)) / 4
    point, normal, cosine = ball_surface(view, pixel, center, radius)
    to_led = place[:, None] - point
    distance = np.linalg.norm(to_led, axis=2)
    signal = 8 * np.maximum(np.sum(to_led * normal, axis=2), 0) / distance**3 * (cosine > 0)
    signal = average(signal.reshape(n_led, 4 * size, 4 * size), 4)
    schedule = Schedule(np.arange(n_led, dtype=np.int32), 20_000.0, 1.0)
    events, on, off, starts = simulate_events(signal, LIGHT, schedule, 6, PIXEL)
    recording = Recording(events, Sensor(size, size, on, off, 52.0), schedule, starts)
    outline = np.array([size / 2, size / 2, radius / np.sqrt(63) / width])
    chosen = ball_pixels(view, outline, (size, size), 0)
    part = watch(recording, chosen, np.cumsum(chosen).reshape(size, size) - 1, 12_000, 0)
    start = center + 3.5 * ring_directions(n_led)
    found = solve_near(view, part, pixel_centers(chosen), outline, start, 10.0, radius, 0.0)
    assert np.linalg.norm(found.position - place, axis=1).max() < 0.1
    assert angular_error_deg(found.direction, place - center).max() < 0.6
    assert 0 < found.position_sigma.max() < 0.1
