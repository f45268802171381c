"""What is modelled of light transport, decided by expected error: right at both sides of each limit."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.effects import light_choice
from evsdr.effects.light_choice import LIMIT_DEG, Asked, first_light
from evsdr.effects.sensitivity import expected_error_deg, signals
from evsdr.light import scene as scenes
from evsdr.light.camera import camera_geometry
from evsdr.light.ground_truth import object_depth, object_normals, surface_maps
from evsdr.light.tracing import led_images, trace_illumination, trace_indirect
from evsdr.shape.traced import traced_mesh
from tests.conftest import REPOSITORY
from tests.support.small_scene import DIFFUSE, camera, leds, scene

POLAR = np.pi / 4


def ring_light(n_led=24, n_band=8):
    """Directions (n_led, 1, 3) and irradiances (n_led, 1) of a far ring."""
    azimuth = 2 * np.pi * np.arange(n_led) / n_led
    direction = np.stack([np.sin(POLAR) * np.cos(azimuth), np.sin(POLAR) * np.sin(azimuth)], axis=-1)
    direction = np.concatenate([direction, np.full((n_led, 1), np.cos(POLAR))], axis=-1)
    return direction[:, None], np.ones((n_led, 1)), [j % n_band for j in range(n_led)]


def load(tmp_path, text):
    (tmp_path / "scene.xml").write_text(text)
    return scenes.load_scene(tmp_path / "scene.xml")


# ---------------------------------------------------------------------- the measure


def test_expected_error_is_the_turn_that_causes_the_change():
    """Signals of a surface turned by 1 degree: the answer is 1 degree."""
    direction, irradiance, band = ring_light()
    normal = np.array([[0.1, -0.2, 1.0], [0.0, 0.3, 1.0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    turned = normal + np.radians(1.0) * np.cross(normal, [[0, 1.0, 0], [1.0, 0, 0]])
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.sum(normal * turned, axis=1)))
    reflectance = np.full((2, 8), 0.3)
    given = normal, reflectance, direction, irradiance, band
    change = signals(turned, reflectance, direction, irradiance, band) - signals(*given)
    error = expected_error_deg(*given, 0.05, change)
    np.testing.assert_allclose(error, angle, rtol=0.05)


def test_brighter_light_turns_no_normal():
    """All LEDs stronger by one factor: reflectances explain it, without constant light exactly."""
    direction, irradiance, band = ring_light()
    given = np.array([[0.1, -0.2, 0.97]]), np.full((1, 8), 0.3), direction, irradiance, band
    change = 0.2 * signals(*given)
    assert expected_error_deg(*given, 1e-6, change)[0] < 0.05
    lopsided = change * (1 + direction[:, 0, 0])
    assert expected_error_deg(*given, 1e-6, lopsided)[0] > 2


# ---------------------------------------------------------------------- cast shadows


def small_ball(distance):
    """A ball before the sphere; it moves away to the side, so that its shadow leaves the sphere."""
    return f"""<shape type="sphere" id="ball"><point name="center" x="{distance}" y="0" z="0.9"/>
        <float name="radius" value="0.1"/>{DIFFUSE}</shape>"""


def with_ball(distance):
    sphere = f'<shape type="sphere" id="object">{DIFFUSE}</shape>'
    return scene(shape=sphere + small_ball(distance), sensor=camera(width=48, height=48))


@pytest.mark.parametrize(("distance", "traced"), [(0.7, True), (9.0, False)])
def test_auto_traces_shadows_that_fall_on_the_object(tmp_path, distance, traced):
    light = first_light(load(tmp_path, with_ball(distance)), Asked())
    assert light.shadows == traced
    assert (light.expected["cast shadows"] > LIMIT_DEG) == traced
    note = light.notes["cast shadows"]
    assert note.startswith("traced on the scene's geometry: " if traced else "not modelled: no (pixel, LED)")


def test_auto_traces_nothing_on_a_sphere():
    ring = scenes.load_scene(REPOSITORY / "scenes" / "sphere.xml", {"size": "32"})
    light = first_light(ring, Asked())
    assert not light.shadows and light.expected["cast shadows"] == 0
    assert all(dr.width(e) == 1 for e in light.illumination.irradiance)


def test_rays_follow_the_chance_they_leave(tmp_path):
    """Shadow edges in few pixels of many need more rays than none."""
    rays = {}
    for name, wanted in (("loose", 30.0), ("strict", 1e-3)):
        ring = load(tmp_path, with_ball(0.7))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(light_choice, "RAYS_LIMIT_DEG", wanted)
            rays[name] = int(
                first_light(ring, Asked(shadows="scene", rays=16)).notes["rays per pixel"].split(":")[0]
            )
    assert rays == {"loose": 4, "strict": 16}


# ---------------------------------------------------------------------- near LEDs


@pytest.mark.parametrize(("distance", "near"), [(4, True), (4000, False)])
def test_auto_tells_near_from_far(tmp_path, distance, near):
    light = first_light(load(tmp_path, scene(light=leds(distance=distance))), Asked())
    assert light.near == near
    assert light.notes["LEDs"].startswith(f"8 in 2 bands, {'near' if near else 'far'}: ")
    assert (dr.width(light.illumination.direction[0]) > 1) == near
    assert ("less" in light.notes["LEDs"]) != near


def test_far_stands_for_near_where_it_may(tmp_path):
    """Asked for, near LEDs become one direction and one irradiance: those of the middle."""
    ring = load(tmp_path, scene(light=leds(distance=4)))
    light = first_light(ring, Asked(leds="far", shadows="off")).illumination
    expected = np.array([1, 0, 1]) / 2**0.5
    got = np.array(light.direction[0]).ravel()
    assert np.degrees(np.arccos(got @ expected)) < 12  # the sphere bulges toward the light
    assert dr.width(light.irradiance[0]) == 1


# ---------------------------------------------------------------------- indirect light


def test_gathered_light_is_that_of_the_renderer(tmp_path):
    """True normals and reflectances on a true relief: paths of two surface points, as the integrator renders."""
    relief = f"""<shape type="ply" id="object"><string name="filename" value="{REPOSITORY}/scenes/relief.ply"/>
        {DIFFUSE}</shape>"""
    ring = load(tmp_path, scene(shape=relief, light=leds(4), sensor=camera(width=32, height=32)))
    direct = led_images(ring, 64, 1).reshape(4, -1)
    ring.integrator.max_depth = 2
    reference = led_images(ring, 256, 1).reshape(4, -1) - direct
    maps = surface_maps(ring, 16)
    light, _ = trace_illumination(ring, 16, True, 1)
    indirect = trace_indirect(ring, maps, light, 2, 1, 0.0)
    reflectance, mask = maps.reflectance.reshape(-1, 2), maps.mask.ravel()
    gathered = np.array([reflectance[:, b] * e.numpy() for b, e in zip(light.band, indirect)])[:, mask]
    reference = reference[:, mask]
    assert reference.mean() > 0.05 * direct.mean()
    assert gathered.mean() == pytest.approx(reference.mean(), rel=0.08)
    assert np.corrcoef(gathered.ravel(), reference.ravel())[0, 1] > 0.9


def test_nothing_else_means_no_indirect_light(tmp_path):
    """A sphere alone sees no other surface."""
    ring = load(tmp_path, scene())
    light, _ = trace_illumination(ring, 4, False)
    indirect = trace_indirect(ring, surface_maps(ring, 4), light, 3, 1, 0.0)
    assert max(float(dr.max(e)[0]) for e in indirect) < 1e-6


# ---------------------------------------------------------------------- geometry


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_mesh_of_the_true_depth_is_the_object(tmp_path, kind):
    """Put in the place of the object, its own depth gives the same depth, normals and ids."""
    ring = load(tmp_path, scene(sensor=camera(kind=kind, width=40, height=40)))
    depth = object_depth(ring)
    geometry, to_world = camera_geometry(ring.sensor)
    surface = make_depth(depth, depth > 0, geometry)
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


def make_depth(depth, mask, geometry):
    from evsdr.shape.depth import Depth

    return Depth(np.where(mask, depth, 0), mask, mask.astype(np.int32), np.zeros(mask.shape), geometry)


def test_every_pixel_lies_on_its_mesh_whole(tmp_path):
    """Also a lonely one, and one in a corner of the film."""
    plane = '<shape type="rectangle" id="object"><transform name="to_world"><scale value="3"/></transform></shape>'
    ring = load(tmp_path, scene(shape=plane))
    geometry, to_world = camera_geometry(ring.sensor)
    mask = np.zeros((ring.height, ring.width), bool)
    mask[0, 0] = mask[6, 7] = True
    other = scenes.with_object(
        ring, *traced_mesh(make_depth(np.full(mask.shape, 4.0), mask, geometry), to_world)
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


def test_traced_mesh_is_smooth_between_pixels():
    """Vertices of a parabola lie on it, also those between pixels."""
    from evsdr.model.view import CameraGeometry

    geometry = CameraGeometry(False, (0.1, 0.1), (6.0, 6.0))
    points = geometry.points(np.zeros((12, 12)))
    depth = 5 + 0.5 * points[..., 0] ** 2 + 0.3 * points[..., 1] ** 2
    position, face = traced_mesh(make_depth(depth, np.ones(depth.shape, bool), geometry), np.eye(4))
    x, y, z = position[(np.abs(position[:, :2]) < 0.4).all(axis=1)].T
    np.testing.assert_allclose(-z, 5 + 0.5 * x**2 + 0.3 * y**2, atol=1e-9)
    normal = np.cross(
        position[face[:, 1]] - position[face[:, 0]], position[face[:, 2]] - position[face[:, 0]]
    )
    assert (normal[:, 2] > 0).all() and len(position) > 4 * depth.size


def test_indirect_light_joins_signal_and_its_slope():
    """LambertianRing: the derivative by log reflectance stays the signal, that by slopes stays the direct one's."""
    from dataclasses import replace

    from evsdr.model.illumination import Illumination
    from evsdr.model.lambert import LambertianRing, led_signals

    light = Illumination([mi.Vector3f(0.6, 0, 0.8)] * 2, [mi.Float(1.0)] * 2, [0, 1], mi.Float(0.05))
    more = replace(light, indirect=[mi.Float(0.1), mi.Float(0.0)])
    p, q, reflectance = mi.Float(0.1), mi.Float(0.2), [mi.Float(0.5), mi.Float(0.25)]
    alone = LambertianRing(light)(p, q, reflectance, mi.Float(1e-4))
    joined = LambertianRing(more)(p, q, reflectance, mi.Float(1e-4))
    for j, extra in enumerate((0.05, 0.0)):
        assert float((joined[0][j] - alone[0][j])[0]) == pytest.approx(extra, abs=1e-6)
        assert float(joined[1][j][0]) == float(alone[1][j][0])
    normal = dr.normalize(mi.Vector3f(-0.1, -0.2, 1))
    assert float(led_signals(more, normal, reflectance)[0][0]) == pytest.approx(
        float(joined[0][0][0]), abs=1e-5
    )
    kept = more.gather(mi.UInt32(0))
    assert kept.indirect is not None


def test_spread_of_leds(tmp_path):
    """A square LED 0.4 wide at 3.5 spreads by 0.4 / sqrt(12) / 3.5; points by nothing."""
    soft = scenes.load_scene(REPOSITORY / "scenes" / "soft_ring.xml", {"size": "8"})
    light, _ = trace_illumination(soft, 1, False)
    assert light.spread == pytest.approx(0.4 / 12**0.5 / 3.5, rel=0.02)
    light, _ = trace_illumination(load(tmp_path, with_ball(0.7)), 1, False)
    assert light.spread == 0
