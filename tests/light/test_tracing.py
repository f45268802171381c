"""What is traced of a sphere against plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.light.ground_truth import object_depth, object_normals, surface_maps
from evsdr.light.scene import load_scene, with_object
from evsdr.light.tracing import led_images, light_at_centre, trace_illumination, trace_indirect
from tests.conftest import REPOSITORY
from tests.support.small_scene import DIFFUSE, HEIGHT, WIDTH, camera, leds, scene

DIRECTION = np.array([[np.cos(a), np.sin(a), 1] for a in 2 * np.pi * np.arange(8) / 8]) / 2**0.5


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    path = tmp_path_factory.mktemp("sphere") / "scene.xml"
    path.write_text(scene())
    return load_scene(path)


def test_led_images_are_lamberts(ring):
    """One ray per pixel centre: reflectance times cosine times power."""
    normal, seen = object_normals(ring), object_depth(ring) > 0
    cosine = np.maximum(np.einsum("hwk,jk->jhw", normal, DIRECTION), 0)
    reflectance = np.interp([450, 620], [430, 640], [0.3, 0.7])
    expected = cosine * reflectance[np.arange(8) % 2][:, None, None]
    np.testing.assert_allclose(led_images(ring, 1)[:, seen], expected[:, seen], atol=2e-3)
    np.testing.assert_array_equal(led_images(ring, 1)[:, ~seen], 0)


def test_trim_dims_leds_on_whatever_object(ring):
    trim = np.linspace(0.3, 1, 8)
    dim = ring.trimmed(trim)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], float)
    placed, dim_placed = (with_object(one, corners, np.array([[0, 1, 2]])) for one in (ring, dim))
    for before, after in ((ring, dim), (placed, dim_placed)):
        np.testing.assert_allclose(after.leds.power, before.leds.power * trim)
        light, whole = (trace_illumination(one, 1, False)[0] for one in (after, before))
        np.testing.assert_allclose(
            [e[0] for e in light.irradiance], trim * [e[0] for e in whole.irradiance], rtol=1e-6
        )
    np.testing.assert_allclose(led_images(dim, 1), led_images(ring, 1) * trim[:, None, None], rtol=1e-6)


def test_far_light_is_the_same_everywhere_without_shadows(ring):
    light, coverage = trace_illumination(ring, 16, False)
    found = np.array([np.array(d, float).ravel() for d in light.direction])
    np.testing.assert_allclose(found, DIRECTION, atol=1e-5)
    np.testing.assert_allclose([float(e[0]) for e in light.irradiance], 1, rtol=1e-4)
    assert (light.band, light.spread) == ([0, 1] * 4, 0) and light.constant_light[0] == np.float32(0.05)
    x = ((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1) * 1.4
    y = ((np.arange(HEIGHT) + 0.5) / HEIGHT * 2 - 1) * 1.4 * HEIGHT / WIDTH
    radius = np.hypot(*np.meshgrid(x, y))
    pixel = 2.8 / WIDTH
    assert (coverage[radius < 1 - pixel] == 1).all() and (coverage[radius > 1 + pixel] == 0).all()
    assert coverage.sum() * pixel**2 == pytest.approx(np.pi, rel=0.02)


def test_light_vectors_at_the_centre(ring, tmp_path):
    np.testing.assert_allclose(light_at_centre(ring), DIRECTION, atol=2e-3)
    (tmp_path / "scene.xml").write_text(scene(light=leds(distance=2.5)))
    np.testing.assert_allclose(light_at_centre(load_scene(tmp_path / "scene.xml")), DIRECTION, atol=2e-3)


def test_a_turned_world_looks_the_same(ring, tmp_path):
    """Camera and LEDs turned together about the sphere: nothing changes in the camera's frame."""
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])

    def turned(text):
        vector = turn @ np.array([float(part) for part in text.split(",")])
        return ", ".join(f"{v:.9f}" for v in vector)

    text = leds()
    for d in DIRECTION:
        old = 'x="{:.6f}" y="{:.6f}" z="{:.6f}"'.format(*-d)
        assert old in text
        text = text.replace(old, 'x="{:.9f}" y="{:.9f}" z="{:.9f}"'.format(*(turn @ -d)))
    sensor = camera().replace("0, 0, 4", turned("0, 0, 4")).replace("0, 1, 0", turned("0, 1, 0"))
    (tmp_path / "scene.xml").write_text(scene(light=text, sensor=sensor))
    other = load_scene(tmp_path / "scene.xml")
    np.testing.assert_allclose(object_normals(other), object_normals(ring), atol=1e-4)
    np.testing.assert_allclose(led_images(other, 1), led_images(ring, 1), atol=1e-3)
    directions = [np.array(d, float).ravel() for d in trace_illumination(other, 1, True)[0].direction]
    np.testing.assert_allclose(directions, DIRECTION, atol=1e-5)


@pytest.fixture(scope="module")
def relief(tmp_path_factory):
    """A white relief, whose slopes light each other."""
    shape = f"""<shape type="ply" id="object"><string name="filename" value="{REPOSITORY}/scenes/relief.ply"/>
        {DIFFUSE}</shape>"""
    path = tmp_path_factory.mktemp("relief") / "scene.xml"
    path.write_text(scene(shape=shape, light=leds(2)))
    ring = load_scene(path)
    maps = surface_maps(ring, 1)
    light, _ = trace_illumination(ring, 1, False)
    known = maps.reflectance[..., :1] > 0

    def indirect(max_depth, reflectance):
        told = replace(maps, reflectance=np.where(known, np.float32(reflectance), 0) + 0 * maps.reflectance)
        return np.array([e.numpy() for e in trace_indirect(ring, told, light, max_depth, 1, 0.0)])

    return indirect


def test_each_surface_on_the_way_adds_light(relief):
    """Each gathering adds less than the one before, and three are the most that are made."""
    mean = [relief(depth, 0.9).mean() for depth in (2, 3, 4)]
    assert 0 < mean[2] - mean[1] < 0.6 * (mean[1] - mean[0]) < 0.6**2 * mean[0]
    assert relief(9, 0.9).mean() == mean[2]


def test_no_surface_sends_more_than_it_gets(relief):
    """Reflectances above 1, as a fit may say, gather what those of 1 do."""
    np.testing.assert_array_equal(relief(3, 2.0), relief(3, 1.0))
