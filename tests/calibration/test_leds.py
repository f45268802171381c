"""Directions as the command finds and writes them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from evsdr.calibration.mirror import reflect
from evsdr.calibration.scene_text import find_leds, flatten
from evsdr.commands import calibrate
from evsdr.events.simulator import simulate_events
from evsdr.files.events_h5 import write_recording
from evsdr.light.camera import view_of
from evsdr.light.scene import load_scene
from evsdr.metrics import angular_error_deg
from evsdr.model.view import pixel_centers
from evsdr.records import Recording, Schedule, Sensor
from tests.support.analytic import ring_directions
from tests.support.balls import LIGHT, PIXEL, average
from tests.support.small_scene import HEIGHT, WIDTH, leds, scene


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
