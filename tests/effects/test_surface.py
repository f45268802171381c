"""The surface of a fit in the place of the object."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects.surface import FittedSurface
from evsdr.light import scene as scenes
from evsdr.light.camera import camera_geometry
from evsdr.light.ground_truth import object_depth, object_normals, surface_maps
from evsdr.light.tracing import trace_illumination
from evsdr.shape.traced import traced_mesh
from tests.conftest import REPOSITORY
from tests.support.depths import make_depth
from tests.support.small_scene import RING, camera, scene
from tests.support.worlds import load


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_mesh_of_the_true_depth_is_the_object(tmp_path, kind):
    """Put in the place of the object, its own depth gives the same depth, normals and ids."""
    ring = load(tmp_path, scene(sensor=camera(kind=kind, width=40, height=40)))
    depth = object_depth(ring)
    geometry, to_world = camera_geometry(ring.sensor)
    surface = make_depth(depth, geometry, depth > 0, object_normals(ring))
    position, face = traced_mesh(surface, to_world)
    other = scenes.with_object(ring, position, face)
    inner = (object_normals(ring)[..., 2] > 0.7) & (depth > 0)
    np.testing.assert_allclose(object_depth(other)[inner], depth[inner], atol=0.01)
    angle = np.sum(object_normals(other) * object_normals(ring), axis=-1)[inner]
    assert np.degrees(np.arccos(np.median(angle))) < 3
    assert [s.id() for s in other.scene.shapes()] == ["object"]
    assert other.leds.n_led == 8
    further = position - to_world[:3, 2]
    scenes.move_object(other, further, face)
    seen = inner if kind == "orthographic" else object_depth(other) > 0
    assert object_depth(other)[seen].min() == pytest.approx(depth[inner].min() + 1, abs=0.01)


def test_unit_and_camera_are_told(tmp_path):
    ring = load(tmp_path, scene(integrator=RING.replace('ring">', 'ring"><string name="unit" value="cm"/>')))
    told, (geometry, to_world) = FittedSurface(ring).told(), camera_geometry(ring.sensor)
    assert told["unit"] == "cm" and json.dumps(told)
    assert told["camera"]["pixel_size"] == geometry.pixel_size and not told["camera"]["perspective"]
    np.testing.assert_array_equal(told["camera"]["to_world"], to_world)
    assert FittedSurface(load(tmp_path, scene())).told()["unit"] is None


def test_every_pixel_lies_on_its_mesh_whole(tmp_path):
    """Also a lonely one, and one in a corner of the film."""
    plane = '<shape type="rectangle" id="object"><transform name="to_world"><scale value="3"/></transform></shape>'
    ring = load(tmp_path, scene(shape=plane))
    geometry, to_world = camera_geometry(ring.sensor)
    mask = np.zeros((ring.height, ring.width), bool)
    mask[0, 0] = mask[6, 7] = True
    other = scenes.with_object(
        ring, *traced_mesh(make_depth(np.full(mask.shape, 4.0), geometry, mask), to_world)
    )
    _, coverage = trace_illumination(other, 16, False)
    assert (coverage[mask] == 1).all()


def test_near_hits_are_the_surface_itself(tmp_path):
    """A wall at 0.2 blocks; not if the first 0.3 of a shadow ray are free."""
    plane = '<shape type="rectangle" id="object"><transform name="to_world"><scale value="3"/></transform></shape>'
    roof = """<shape type="disk" id="roof"><transform name="to_world"><scale value="9"/>
        <translate z="0.15"/></transform></shape>"""
    sensor = camera().replace("0, 0, 4", "0, 0, 0.1")
    ring = load(tmp_path, scene(shape=plane + roof, sensor=sensor))
    for skip, lit in ((0.0, False), (0.3, True)):
        light, _ = trace_illumination(ring, 1, True, 0, skip)
        assert (light.irradiance[0].numpy() > 0).all() == lit


def test_spread_of_leds(tmp_path):
    """A square LED 0.4 wide at 3.5 spreads by 0.4 / sqrt(12) / 3.5; points by nothing."""
    soft = scenes.load_scene(REPOSITORY / "scenes" / "soft_ring.xml", {"size": "8"})
    light, _ = trace_illumination(soft, 1, False)
    assert light.spread == pytest.approx(0.4 / 12**0.5 / 3.5, rel=0.02)
    light, _ = trace_illumination(load(tmp_path, scene()), 1, False)
    assert light.spread == 0


def fit_of(ring):
    """A fit that found the truth."""
    maps = surface_maps(ring, 4)
    return SimpleNamespace(maps=maps, problem=SimpleNamespace(grid=SimpleNamespace(mask=maps.mask)))


def test_a_scene_follows_its_fit(tmp_path):
    """The same fit gives the same scene at once; the length of a pixel is that of an orthographic camera."""
    ring = load(tmp_path, scene(sensor=camera(width=40, height=40)))
    surface, fit = FittedSurface(ring), fit_of(ring)
    there, length = surface.follow(fit, 0.5)
    assert length == pytest.approx(0.5 * 2.8 / 40)
    inner = (object_normals(ring)[..., 2] > 0.7) & fit.maps.mask
    angle = np.sum(object_normals(there) * object_normals(ring), axis=-1)[inner]
    assert np.degrees(np.arccos(np.median(angle))) < 3
    flat = fit_of(ring)
    flat.maps.normal[...] = (0, 0, 1)
    again, _ = surface.follow(flat, 0.5)
    assert again is there and object_normals(there)[inner][:, 2].min() > 0.99
    assert set(surface.files(surface.depth(fit), fit.maps)) == {"depth.exr", "mesh.ply"}


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_a_surface_may_be_nearer_than_what_stands_for_it(tmp_path, kind):
    """The rectangle, and the surface of a fit, whose normals stay; what is nearer by nothing is where it was."""
    sensor, plane = camera(kind=kind, width=40, height=40), '<shape type="rectangle" id="object"/>'
    ring = load(tmp_path, scene(sensor=sensor, shape=plane))
    surface, fit = FittedSurface(ring), fit_of(ring)
    assert surface.placeholder(0.0) is ring
    inner = object_depth(surface.follow(fit, 0.5)[0]) > 0
    for by in (0.3, -0.2):
        for there in (surface.placeholder(by), surface.follow(fit, 0.5, by)[0]):
            seen = inner & (object_depth(there) > 0)
            np.testing.assert_allclose(object_depth(there)[seen], 4 - by, atol=1e-3)
        depth = surface.depth(fit, by)
        np.testing.assert_allclose(depth.depth[depth.mask], 4 - by, atol=1e-3)
    np.testing.assert_allclose(object_depth(surface.follow(fit, 0.5)[0])[inner], 4, atol=1e-3)
    assert surface.extent == pytest.approx(2.0, abs=0.1)
