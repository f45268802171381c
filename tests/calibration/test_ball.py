"""LED directions from matt and mirror balls."""

import json
from dataclasses import replace

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
from evsdr.calibration.equations import collect_pairs, thin
from evsdr.calibration.mirror import find_highlights, led_contrast, reflect
from evsdr.calibration.scene_text import find_leds, flatten
from evsdr.commands import calibrate
from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.files.events_h5 import write_recording
from evsdr.light.camera import view_of
from evsdr.light.scene import load_scene
from evsdr.metrics import angular_error_deg
from evsdr.model.view import CameraGeometry, View, pixel_centers
from evsdr.records import Events, Recording, Schedule, Sensor
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals
from tests.support.event_reference import find_events, light_path
from tests.support.small_scene import HEIGHT, WIDTH, leds, scene

SIZE, EXTENT, LIGHT = 32, 1.15, 0.05
OUTLINE = np.array([SIZE / 2, SIZE / 2, SIZE / 2 / EXTENT])
PIXEL = EventPixel().idealised()


@pytest.fixture(autouse=True)
def few_pairs(monkeypatch):
    """Enough for the accuracy asked for, and quick."""
    monkeypatch.setattr("evsdr.calibration.equations.MOST_PAIRS", 12_000)


def camera(size: int = SIZE, perspective: bool = False) -> View:
    """Look from z = 10 at a film of the analytic sphere's extent."""
    width = 2 * EXTENT / size / (10 if perspective else 1)
    geometry = CameraGeometry(perspective, (width, width), (size / 2, size / 2))
    return View(geometry, np.eye(3), np.array([0.0, 0.0, 10.0]))


def moved_directions(rng) -> np.ndarray:
    """Give LEDs that lie a few degrees off the nominal ring."""
    direction = ring_directions() + rng.normal(0, 0.06, (24, 3))
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


def average(signal: np.ndarray, factor: int) -> np.ndarray:
    """Average images (n, H, W) over blocks of pixels."""
    n, height, width = signal.shape
    return signal.reshape(n, height // factor, factor, width // factor, factor).mean(axis=(2, 4))


def solve(view, recording, mask=None):
    count = np.zeros((recording.sensor.height, recording.sensor.width), int)
    np.add.at(count, (recording.events.y, recording.events.x), 1)
    outline = fit_outline(view, firing_mask(count) if mask is None else mask)
    chosen = ball_pixels(view, outline, count.shape, 0)
    pairs = thin(collect_pairs(recording, chosen, np.cumsum(chosen).reshape(count.shape) - 1), 0)
    n_led = int(recording.schedule.order.max()) + 1
    return solve_far(view, pairs, pixel_centers(chosen), outline, ring_directions(n_led), 10.0)


def test_directions_within_a_third_of_a_degree(rng):
    """A ball with LEDs off the ring and of unequal power, seen by pixels of finite size."""
    truth, power = moved_directions(rng), rng.uniform(0.7, 1.3, 24)
    normal, mask = sphere_normals(4 * SIZE)
    signal = average(
        lambert_signals(normal, np.full((*mask.shape, 1), 0.6), truth) * mask * power[:, None, None], 4
    )
    schedule = Schedule(np.arange(24, dtype=np.int32), 20_000.0, 1.0)
    events, on, off, starts = simulate_events(signal, LIGHT, schedule, 2, PIXEL)
    recording = Recording(events, Sensor(SIZE, SIZE, on, off, 52.0), schedule, starts)
    found = solve(camera(), recording)
    error = angular_error_deg(found.direction, truth)
    assert error.max() < 0.3
    assert 0.5 < np.sqrt(np.mean(error**2)) / np.sqrt(np.mean(found.sigma_deg**2)) < 2.5
    np.testing.assert_allclose(found.outline, OUTLINE, atol=0.05)
    np.testing.assert_allclose(found.strength, power / power.mean(), rtol=0.01)
    np.testing.assert_allclose(found.constant_light, LIGHT / (0.6 * power.mean()), rtol=0.02)
    assert found.solution.noise == pytest.approx(0.02, rel=0.15)


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


@pytest.mark.parametrize("perspective", [False, True])
def test_highlights_of_a_mirror_ball(rng, perspective):
    """Blobs of a finite LED, mirrored by brute force: each pixel looks for the LED that it reflects."""
    size, fine = 6 * SIZE, 2
    view, truth = camera(size, perspective), moved_directions(rng)
    outline = np.array([size / 2 + 0.4, size / 2 - 0.7, 0.8 * size / 2])
    pixel = pixel_centers(np.ones((size * fine, size * fine), bool)) / fine
    on_ball = np.linalg.norm(pixel - outline[:2], axis=1) < outline[2] * 0.99
    cosine = truth @ reflect(view, pixel, outline).T
    signal = np.exp((cosine - 1) / np.radians(2.0) ** 2) * on_ball
    signal = average(signal.reshape(24, size * fine, size * fine), fine)
    order = [k for j in range(24) for k in (j, -1)]  # each LED from darkness
    schedule = Schedule(np.array(order, np.int32), 5000.0, 1.0)
    events, on, off, starts = simulate_events(20 * signal, LIGHT, schedule, 1, PIXEL)
    recording = Recording(events, Sensor(size, size, on, off, 52.0), schedule, starts)
    found = find_highlights(view, led_contrast(recording, 24), outline, 0.05)
    error = angular_error_deg(found.direction, truth)
    print(error.mean(), error.max(), found.sigma_deg.mean())
    assert error.max() < 0.6 and error.mean() < 0.3
    assert np.sqrt(np.mean((error / found.sigma_deg) ** 2)) < 2.0
    with pytest.raises(InputError, match="LED 3 leaves no highlight"):
        count = led_contrast(recording, 24)
        count[3] = 0
        find_highlights(view, count, outline)


def test_reflection_by_hand():
    """Seen from above, the middle shows the camera, and n at 22.5 degrees shows a light at 45 degrees."""
    view = camera(200)
    outline = np.array([100.0, 100.0, 80.0])
    shift = 80 * np.sin(np.radians(22.5))
    shown = reflect(view, np.array([[100.0, 100.0], [100 + shift, 100], [100, 100 - shift]]), outline)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(shown, [[0, 0, 1], [half, 0, half], [0, half, half]], atol=1e-12)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_view_of_a_scene(tmp_path, kind):
    """The camera in plain numbers looks along Mitsuba's own rays."""
    view = '<float name="fov" value="35"/>' * (kind == "perspective")
    sensor = f"""<sensor type="{kind}" id="camera">{view}
        <transform name="to_world"><lookat origin="1,2,4" target="0.2,-0.1,0.3" up="0.3,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="{WIDTH}"/><integer name="height" value="{HEIGHT}"/>
        </film></sensor>"""
    (tmp_path / "scene.xml").write_text(scene(sensor=sensor))
    ring = load_scene(tmp_path / "scene.xml")
    view = view_of(ring)
    pixel = np.array([[3.25, 7.5], [11.0, 2.0]])
    origin, d = view.rays(pixel)
    for at, o, toward in zip(pixel, origin, d):
        ray, _ = ring.sensor.sample_ray(0.0, 0.5, [float(at[0]) / WIDTH, float(at[1]) / HEIGHT], [0.5, 0.5])
        expected = np.array(ray.d).ravel()
        np.testing.assert_allclose(toward @ view.frame, expected, atol=1e-5)
        off = np.array(ray.o).ravel() - view.point_to_world(o)
        np.testing.assert_allclose(np.cross(off, expected), 0, atol=1e-5)
    point = origin + 2.5 * d
    np.testing.assert_allclose(view.project(point), pixel, atol=1e-4)
    np.testing.assert_allclose(view.point_to_camera(view.point_to_world(point)), point, atol=1e-6)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A scene whose LEDs are told wrong, and a recording of its sphere."""
    folder = tmp_path_factory.mktemp("ball")
    n = 8
    rng = np.random.default_rng(5)
    truth = ring_directions(n) + rng.normal(0, 0.05, (n, 3))
    truth /= np.linalg.norm(truth, axis=1, keepdims=True)
    light = leds(n)
    (folder / "scene.xml").write_text(scene(light=light))
    width, height = 4 * WIDTH, 4 * HEIGHT
    film = f'value="{width}"', f'value="{height}"'
    text = scene(light=light).replace(f'value="{WIDTH}"', film[0]).replace(f'value="{HEIGHT}"', film[1])
    text = text.replace('<scale x="1.4" y="1.4"/>', '<scale x="1.8" y="1.8"/>')
    (folder / "scene.xml").write_text(text)
    ring = load_scene(folder / "scene.xml")
    view = view_of(ring)
    fine = 6
    pixel = (
        np.stack(np.meshgrid(np.arange(width * fine), np.arange(height * fine)), -1).reshape(-1, 2) + 0.5
    ) / fine
    origin, _ = view.rays(pixel)
    square = 1 - np.sum(origin[:, :2] ** 2, axis=1)
    normal = np.column_stack([origin[:, :2], np.sqrt(np.maximum(square, 0))])
    signal = 0.5 * np.maximum(truth @ normal.T, 0) * (square > 0)
    signal = average(signal.reshape(n, height * fine, width * fine), fine)
    schedule = Schedule(np.arange(n, dtype=np.int32), 20_000.0, 1.0)
    events, on, off, starts = simulate_events(signal, LIGHT, schedule, 3, PIXEL)
    recording = Recording(events, Sensor(width, height, on, off, 52.0), schedule, starts)
    write_recording(folder / "events.h5", recording)
    write_recording(folder / "hard.h5", replace(recording, schedule=replace(schedule, crossfade=0.0)))
    return folder, truth


def run(folder, *arguments) -> int:
    return calibrate.main(["directions", str(folder / "scene.xml"), str(folder / "events.h5"), *arguments])


def test_command_writes_a_rig_that_loads(ball, tmp_path):
    folder, truth = ball
    assert run(folder, "--out", str(tmp_path / "out")) == 0
    assert {f.name for f in (tmp_path / "out").iterdir()} == {"rig.xml", "calibration.json", "residuals.png"}
    said = json.loads((tmp_path / "out" / "calibration.json").read_text())
    error = angular_error_deg([led["direction"] for led in said["leds"]], truth)
    assert error.max() < 0.3
    text = scene(light='<include filename="out/rig.xml"/>')
    (tmp_path / "scene.xml").write_text(text)
    ring = load_scene(tmp_path / "scene.xml")
    assert ring.leds.n_led == 8 and ring.leds.n_band == 2
    light, _ = ring.integrator.illumination(ring.scene, ring.sensor, 1, 0, False)
    loaded = np.array([np.array(d).ravel() for d in light.direction])
    np.testing.assert_allclose(loaded, [led["direction"] for led in said["leds"]], atol=1e-5)
    np.testing.assert_allclose(ring.leds.power, load_scene(folder / "scene.xml").leds.power, rtol=1e-5)


def test_mirror_command(ball, tmp_path):
    """Highlights that the command finds on a ball of 40 pixels."""
    folder, truth = ball
    view = view_of(load_scene(folder / "scene.xml"))
    width, height, fine = 4 * WIDTH, 4 * HEIGHT, 4
    pixel = pixel_centers(np.ones((height * fine, width * fine), bool)) / fine
    outline = np.array([32.0, 24.0, 20.0])
    on_ball = np.linalg.norm(pixel - outline[:2], axis=1) < 0.99 * outline[2]
    signal = 20 * on_ball * np.exp((truth @ reflect(view, pixel, outline).T - 1) / np.radians(4.0) ** 2)
    signal = average(signal.reshape(8, height * fine, width * fine), fine)
    schedule = Schedule(np.array([k for j in range(8) for k in (j, -1)], np.int32), 5000.0, 1.0)
    events, on, off, starts = simulate_events(signal, LIGHT, schedule, 2, PIXEL)
    write_recording(
        tmp_path / "m.h5", Recording(events, Sensor(width, height, on, off, 52.0), schedule, starts)
    )
    arguments = ["directions", str(folder / "scene.xml"), str(tmp_path / "m.h5"), "--ball", "mirror"]
    assert calibrate.main([*arguments, "--circle", "32", "24", "20", "--out", str(tmp_path / "out")]) == 0
    said = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert angular_error_deg([led["direction"] for led in said["leds"]], truth).max() < 1.0
    assert len(find_leds(flatten(tmp_path / "out" / "rig.xml", {}))) == 8


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
    pairs = thin(collect_pairs(recording, chosen, np.cumsum(chosen).reshape(size, size) - 1), 0)
    start = center + 3.5 * ring_directions(n_led)
    found = solve_near(view, pairs, pixel_centers(chosen), outline, start, 10.0, radius, 0.0)
    assert np.linalg.norm(found.position - place, axis=1).max() < 0.1
    assert angular_error_deg(found.direction, place - center).max() < 0.6
    assert 0 < found.position_sigma.max() < 0.1


@pytest.mark.parametrize(
    "arguments, says",
    [
        (["--circle", "900", "10", "20"], "is not on the image of 64 x 48 pixels"),
        (["--circle", "32", "24", "2"], "pixels see the ball; 50 at least"),
        (["--ball", "mirror"], "give --circle or --mask"),
        (["--ball", "mirror", "--near", "--circle", "32", "24", "8"], "directions, not distances"),
        (["--mask", "edge.npy"], "outline leaves the image"),
        (["--mask", "dot.npy"], "too few to find its outline"),
    ],
)
def test_what_can_not_be_used_is_refused(ball, tmp_path, capsys, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    mask = np.zeros((4 * HEIGHT, 4 * WIDTH), np.uint8)
    mask[5, 5] = 1
    np.save("dot.npy", mask)
    mask[:, :12] = 1
    np.save("edge.npy", mask)
    assert run(ball[0], "--out", str(tmp_path / "out"), *arguments) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_hard_switches_are_refused(ball, tmp_path, capsys):
    folder, _ = ball
    arguments = [
        "directions",
        str(folder / "scene.xml"),
        str(folder / "hard.h5"),
        "--out",
        str(tmp_path / "out"),
    ]
    assert calibrate.main(arguments) == 2
    assert "crossfade is 0" in capsys.readouterr().err
