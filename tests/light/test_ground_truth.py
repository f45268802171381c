"""Normals, depth and reflectance of a sphere as formulas tell them."""

import numpy as np
import pytest

from evsdr.light.ground_truth import object_depth, object_normals, surface_maps
from evsdr.light.scene import load_scene
from tests.support.small_scene import DIFFUSE, HEIGHT, WIDTH, camera, scene

TURNED = '<transform name="to_world"><scale value="9"/><rotate y="1" angle="150"/></transform>'
TWO_SIDED = f'<bsdf type="twosided">{DIFFUSE}</bsdf>'


def load(path, text):
    (path / "scene.xml").write_text(text)
    return load_scene(path / "scene.xml")


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    return load(tmp_path_factory.mktemp("sphere"), scene())


def centres():
    """x and y (H, W) of the pixels' centres on the film, 2.8 wide."""
    x = ((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1) * 1.4
    y = -((np.arange(HEIGHT) + 0.5) / HEIGHT * 2 - 1) * 1.4 * HEIGHT / WIDTH
    return np.meshgrid(x, y)


def test_normals_and_depth_at_the_centres(ring):
    x, y = centres()
    seen = x**2 + y**2 < 1
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    np.testing.assert_array_equal(object_depth(ring) > 0, seen)
    np.testing.assert_allclose(object_depth(ring)[seen], (4 - z)[seen], atol=1e-4)
    np.testing.assert_allclose(object_normals(ring)[seen], np.stack([x, y, z], axis=-1)[seen], atol=1e-4)
    np.testing.assert_array_equal(object_normals(ring)[~seen], np.tile([0, 0, 1], ((~seen).sum(), 1)))


def test_depth_of_a_perspective_camera_is_along_its_axis(tmp_path):
    plane = '<shape type="rectangle" id="object"><transform name="to_world"><scale value="9"/></transform></shape>'
    ring = load(tmp_path, scene(shape=plane, sensor=camera(kind="perspective")))
    np.testing.assert_allclose(object_depth(ring), 4, atol=1e-4)


def test_maps_are_means_over_whole_pixels(ring):
    maps = surface_maps(ring, 64)
    x, y = centres()
    radius, half = np.hypot(x, y), 1.4 / WIDTH
    assert (maps.mask[radius < 1 - 2 * half]).all() and not maps.mask[radius > 1 - 0.5 * half].any()
    np.testing.assert_allclose(np.linalg.norm(maps.normal, axis=-1), 1, atol=1e-5)
    inner = radius < 0.6
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    np.testing.assert_allclose(maps.normal[inner], np.stack([x, y, z], axis=-1)[inner], atol=0.02)


def test_reflectance_is_the_mean_over_each_leds_spectrum(ring):
    """Linear from 0.3 at 430 nm to 0.7 at 640 nm, under triangles about 450 and 620 nm."""
    maps = surface_maps(ring, 1)
    np.testing.assert_allclose(maps.band_wavelength_nm, [450, 620], atol=0.5)
    expected = [0.3 + 0.4 * (nm - 430) / 210 for nm in (450, 620)]
    np.testing.assert_allclose(
        maps.reflectance[maps.mask], np.tile(expected, (maps.mask.sum(), 1)), atol=2e-3
    )
    assert (maps.reflectance[object_depth(ring) == 0] == 0).all()


def test_pixels_that_are_covered_in_part_know_the_reflectance_of_that_part(ring):
    maps = surface_maps(ring, 64)
    edge = ~maps.mask & (maps.reflectance[..., 0] > 0)
    expected = [0.3 + 0.4 * (nm - 430) / 210 for nm in (450, 620)]
    np.testing.assert_allclose(maps.reflectance[edge], np.tile(expected, (edge.sum(), 1)), atol=2e-3)
    assert edge.sum() > 10


def test_normals_of_a_surface_seen_from_behind_face_the_camera(tmp_path):
    """A plane that is turned away by 150 degrees shows its back, 30 degrees oblique."""
    ring = load(tmp_path, scene(shape=f'<shape type="rectangle" id="object">{TURNED}{TWO_SIDED}</shape>'))
    expected = np.broadcast_to([-0.5, 0, 3**0.5 / 2], (HEIGHT, WIDTH, 3))
    np.testing.assert_allclose(object_normals(ring), expected, atol=1e-5)
    np.testing.assert_allclose(surface_maps(ring, 4).normal, expected, atol=1e-5)


def test_back_sides_that_reflect_nothing_are_none_of_the_object(tmp_path):
    """As the renderer has it: a tube that is cut off at y = 0 shows its inside where z < 0 of its wall."""
    tube = '<point name="p0" x="0" y="-3" z="0"/><point name="p1" x="0" y="0" z="0.5"/>'
    seen = {}
    for name, material in (("one side", DIFFUSE), ("both", TWO_SIDED)):
        ring = load(tmp_path, scene(shape=f'<shape type="cylinder" id="object">{tube}{material}</shape>'))
        seen[name] = surface_maps(ring, 16).mask
        signal = np.array(ring.integrator.render(ring.scene, spp=16)) - ring.integrator.constant_light[0]
        reflects = signal.max(axis=-1) > 1e-6
        assert not (seen[name] & ~reflects).any()
    assert (seen["one side"] <= seen["both"]).all()
    assert np.count_nonzero(seen["both"] & ~seen["one side"]) > 5 < np.count_nonzero(seen["one side"])


def test_edges_within_a_band_are_seen_alike_by_renderer_and_truth(tmp_path):
    text = scene().replace('value="430:0.3, 640:0.7"', 'value="360:0.1, 452.9:0.1, 453:0.9, 830:0.9"')
    ring = load(tmp_path, text)
    maps = surface_maps(ring, 1)
    signal = np.array(ring.integrator.render(ring.scene, spp=1)) - ring.integrator.constant_light[0]
    normal = object_normals(ring)
    direction = np.array(
        [np.ravel(d) for d in ring.integrator.illumination(ring.scene, ring.sensor, 1)[0].direction]
    )
    cosine = np.maximum(normal @ direction.T, 0)
    lit = (cosine > 0.2) & maps.mask[..., None]
    for j, band in enumerate(ring.leds.band):
        here = lit[..., j]
        found = signal[..., j][here] / (cosine[..., j][here] * ring.leds.power[j])
        np.testing.assert_allclose(found, maps.reflectance[..., band][here], atol=5e-3)
    assert 0.2 < maps.reflectance[maps.mask][0, 0] < 0.8
