"""What LEDs of any shape send, against renders of stock Mitsuba and a sum over lit samples."""

import mitsuba as mi
import numpy as np
import pytest

from tests.support.ring_scenes import HEIGHT, WIDTH, camera, diffuse, far, load, plane, ring, spectrum

POSITION = (2.2, 0.9, 2.2)
RADIUS = 0.6
TURN = mi.ScalarTransform4f
FACING = TURN().look_at(POSITION, [0, 0, 0], [0.1, 1, 0.2])
END = np.array([0.0, 0.5, 0.1])


def dome():
    """A mesh of a half ball, as a bulb's; all faces look outward."""
    tilt, turn = np.linspace(0, np.pi / 2, 7), np.arange(16) * np.pi / 8
    t, f = np.meshgrid(tilt, turn, indexing="ij")
    point = RADIUS * np.stack([np.sin(t) * np.cos(f), np.sin(t) * np.sin(f), np.cos(t)], axis=-1)
    index = np.arange(t.size).reshape(t.shape)
    a, b = index[:-1], np.roll(index, -1, axis=1)[:-1]
    c, d = index[1:], np.roll(index, -1, axis=1)[1:]
    face = np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in ((a, c, b), (b, c, d))])
    return point.reshape(-1, 3), face


@pytest.fixture
def led(tmp_path):
    def make(kind):
        if kind == "mesh":
            point, face = dome()
            path = tmp_path / "dome.obj"
            lines = ["v %g %g %g" % tuple(p) for p in point] + ["f %d %d %d" % tuple(f + 1) for f in face]
            path.write_text("\n".join(lines) + "\n")
            shape = {"type": "obj", "filename": str(path), "face_normals": True, "to_world": FACING}
        else:
            shape = {
                "sphere": {"type": "sphere", "center": list(POSITION), "radius": RADIUS},
                "disk": {"type": "disk", "to_world": FACING @ TURN().scale(RADIUS)},
                "rectangle": {"type": "rectangle", "to_world": FACING @ TURN().scale([RADIUS, 0.2, 1])},
                "cylinder": {
                    "type": "cylinder",
                    "p0": list(POSITION + END),
                    "p1": list(POSITION - END),
                    "radius": 0.2,
                },
            }[kind]
        return shape | {"emitter": {"type": "area", "radiance": spectrum(1.0)}}

    return make


NORMALS = np.array([[0.2, 0.0, 1.0], [0.9, 0.0, 1.0], [0.2, 0.8, 1.0]])
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)


def stock_irradiance(light, normal):
    """What stock renders of a small white square at the origin that looks along a normal."""
    square = {
        "type": "rectangle",
        "to_world": TURN().look_at([0, 0, 0], normal.tolist(), [0.1, 1, 0]) @ TURN().scale(1e-3),
        "bsdf": diffuse(1.0),
    }
    view = camera(0.5 * normal, half_width=5e-4, response=[(360, 1.0), (830, 1.0)], width=1, height=1)
    image = mi.load_dict({"type": "direct"}).render(load({"square": square, "led": light}, view), spp=1 << 15)
    return np.pi * np.array(image).item()


KINDS = ["sphere", "disk", "rectangle", "cylinder", "mesh"]


@pytest.mark.parametrize("kind", KINDS)
def test_direction_and_irradiance_are_those_of_stock(led, kind):
    """LEDs some 40 degrees wide: three squares tell the vector."""
    expected = np.linalg.solve(NORMALS, [stock_irradiance(led(kind), n) for n in NORMALS])
    objects = {"object": plane(), "led_0": led(kind), "led_1": far((0, 0, 1))}
    scene = load(objects, camera(half_width=1e-3))
    light, _ = ring().illumination(scene, scene.sensors()[0], 1, 0, False)
    middle = HEIGHT * WIDTH // 2 + WIDTH // 2
    found = np.array(light.direction[0])[:, middle] * np.array(light.irradiance[0])[middle]
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(expected), rel=0.02)
    cosine = found @ expected / np.linalg.norm(found) / np.linalg.norm(expected)
    assert np.degrees(np.arccos(min(cosine, 1))) < 0.5


@pytest.mark.parametrize("kind", KINDS)
def test_visibility_counts_the_samples_that_irradiance_counts(led, kind):
    """Irradiance times n . l is the mean of what a floor behind a screen shows, in half shadow too."""
    screen = plane(0.0, 90.0, at=(1.2, 0, 0.6), half_width=(0.6, 9, 1))
    objects = {"object": plane(), "screen": screen, "led_0": led(kind), "led_1": far((0, 0, 1))}
    scene = load(objects, camera(half_width=1.0))
    spp, sensor = 256, scene.sensors()[0]
    signal = np.array(ring().signals(scene, sensor, spp)[0]).reshape(HEIGHT, WIDTH).mean(axis=0)
    light, _ = ring().illumination(scene, sensor, spp)
    found = np.array(light.irradiance[0] * light.direction[0].z).reshape(HEIGHT, WIDTH).mean(axis=0)
    assert signal.min() < 0.1 * signal.max()
    assert np.count_nonzero((signal > 0.2 * signal.max()) & (signal < 0.8 * signal.max())) > 2
    np.testing.assert_allclose(found, signal, atol=0.03 * signal.max())
