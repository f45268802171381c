"""Image-space textures of the ring integrator: what they render, and their gradients."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from evsdr.integrators.ring import RingIntegrator

from experiments.gradients import compare
from tests.support.ring_scenes import (
    HEIGHT,
    WIDTH,
    ball_normals,
    camera,
    diffuse,
    far,
    load,
    near,
    peak,
    plane,
    ring,
    soft,
)

BALL = {
    "object": {"type": "sphere", "bsdf": diffuse([(400, 0.1), (700, 0.7)])},
    "led_0": far((1, 0.2, 1), peak(460, 2.0)),
    "led_1": near((-1, 1, 2.5), peak(600, 5.0)),
    "led_2": far((0, -1, 0.8), peak(600, 1.0)),
}
POLE = {"pole": {"type": "cylinder", "p0": [0.8, 0.3, 0.5], "p1": [0.4, 0.2, 1.6], "radius": 0.15}}


def set_textures(integrator, **value):
    params = mi.traverse(integrator)
    for name, array in value.items():
        params[name] = mi.TensorXf(np.ascontiguousarray(array, np.float32))
    params.update()


def test_textures_are_traversed():
    assert set(mi.traverse(ring()).keys()) == {"constant_light", "normal", "reflectance"}


@pytest.mark.parametrize("shadow", [False, True], ids=["lit", "shadow"])
@pytest.mark.parametrize("turned", [False, True], ids=["frontal", "turned"])
def test_true_textures_render_the_scene(shadow, turned):
    view = camera((4, 2, 8), (0.2, 1, 0.1)) if turned else camera()
    scene = load(BALL | (POLE if shadow else {}), view)
    integrator = ring(constant_light=0.05)
    forward = np.array(integrator.render(scene, spp=1))
    normal, on_ball = ball_normals()
    seen = np.array(integrator.illumination(scene, scene.sensors()[0], 1)[1]).reshape(on_ball.shape) == 1
    assert (on_ball & ~seen).any() == shadow
    reflectance = np.broadcast_to(np.interp([460, 600], [400, 700], [0.1, 0.7]), (HEIGHT, WIDTH, 2))
    set_textures(integrator, normal=3.0 * normal, reflectance=reflectance)
    textured = np.array(integrator.render(scene, spp=1))
    np.testing.assert_allclose(textured[seen], forward[seen], rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(textured[~seen], np.float32(0.05))
    unlit = (forward == np.float32(0.05))[seen]
    assert unlit.any() and not unlit.all()


def test_another_scene_is_traced_anew():
    integrator = ring()
    normal, _ = ball_normals()
    set_textures(integrator, normal=normal + [0, 0, 0.1], reflectance=np.ones((HEIGHT, WIDTH, 2)))
    lit, shaded = load(BALL), load(BALL | POLE)
    one, other, again = (np.array(integrator.render(scene, spp=1)) for scene in (lit, shaded, lit))
    assert np.sum(one) > 1.01 * np.sum(other)
    np.testing.assert_array_equal(one, again)
    assert (np.array(integrator.render(lit, spp=4)) != one).any()
    dim = load(BALL | {"led_2": far((0, -1, 0.8), peak(600, 0.5))})
    np.testing.assert_allclose(np.array(integrator.render(dim, spp=1))[..., 2], 0.5 * one[..., 2], rtol=1e-5)


WITH_RING = BALL | {"integrator": {"type": "ring"}, "led_3": soft((0, -1, 3), 0.2, peak(600, 1.0))}
CHANGES = {
    "led_0.irradiance.values": lambda v, d: v * (1 + d),
    "led_0.to_world": lambda v, d: mi.Transform4f().rotate([0, 1, 0], 10 * d) @ v,
    "led_1.intensity.values": lambda v, d: v * (1 + d),
    "led_1.position": lambda v, d: v + mi.Vector3f(d, 0, 0.5 * d),
    "led_3.emitter.radiance.values": lambda v, d: v * (1 + d),
    "led_3.to_world": lambda v, d: mi.Transform4f().translate(mi.Point3f(0.3 * d, d, 0)) @ v,
    "object.to_world": lambda v, d: mi.Transform4f().translate(mi.Point3f(d, 0, 0)) @ v,
    "camera.to_world": lambda v, d: mi.Transform4f().translate(mi.Point3f(d, 0, 0)) @ v,
}


def textured(integrator):
    """Set smooth textures, so that nowhere n . l changes its sign by a small change."""
    normal, _ = ball_normals()
    normal = 0.2 * normal + [0, 0, 1]
    set_textures(integrator, normal=normal, reflectance=np.full((HEIGHT, WIDTH, 2), 0.5))


def put(scene, name, value):
    params = mi.traverse(scene)
    params[name] = value
    params.update()


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_changed_in_the_scene_is_traced_anew(name):
    scene = load(WITH_RING)
    integrator = scene.integrator()
    textured(integrator)
    before = np.array(integrator.render(scene, spp=1))
    value = mi.traverse(scene)[name]
    put(scene, name, CHANGES[name](type(value)(value), mi.Float(0.2)))
    after = np.array(integrator.render(scene, spp=1))
    textured(fresh := ring())
    assert np.abs(after - before).max() > 1e-3
    np.testing.assert_allclose(after, np.array(fresh.render(scene, spp=1)), rtol=1e-6)


@pytest.mark.parametrize("spp", [1, 4])
@pytest.mark.parametrize("mode", ["forward", "reverse"])
@pytest.mark.parametrize("name", [name for name in CHANGES if name.startswith("led")])
def test_derivatives_by_leds_equal_finite_differences(name, spp, mode):
    scene = load(WITH_RING)
    integrator = scene.integrator()
    textured(integrator)
    value = mi.traverse(scene)[name]
    value = type(value)(value)

    def loss(d):
        put(scene, name, CHANGES[name](value, d))
        return dr.sum(dr.square(integrator.render(scene, spp=spp, seed=3) - 0.2), axis=None)

    step = 1e-2
    finite = (loss(mi.Float(step)).numpy() - loss(mi.Float(-step)).numpy()).item() / (2 * step)
    d = mi.Float(0.0)
    dr.enable_grad(d)
    of_d = loss(d)
    if mode == "forward":
        dr.forward(d)
        automatic = dr.grad(of_d)
    else:
        dr.backward(of_d)
        automatic = dr.grad(d)
    assert abs(finite) > 1e-3
    assert automatic.numpy().item() == pytest.approx(finite, rel=5e-3)


@pytest.mark.parametrize("spp", [1, 4, 9])
def test_derivatives_by_materials_in_reverse(spp):
    """By the scene's own surfaces, above one ray per pixel too: light is linear in a reflectance."""
    scene, name = load(WITH_RING), "object.bsdf.reflectance.values"
    value = mi.traverse(scene)[name]
    dr.enable_grad(value)
    put(scene, name, value)
    image = scene.integrator().render(scene, spp=spp)
    dr.backward(dr.sum(image, axis=None))
    by_values = dr.grad(mi.traverse(scene)[name]).numpy() @ value.numpy()
    assert by_values == pytest.approx(np.array(image).sum(), rel=1e-4)


def test_another_seed_is_traced_anew():
    """The shadow of the pole on the ball's pixels is sampled at other places."""
    integrator, scene = ring(), load(BALL | POLE)
    normal, _ = ball_normals()
    set_textures(integrator, normal=normal + [0, 0, 0.1], reflectance=np.ones((HEIGHT, WIDTH, 2)))
    one, other, again = (np.array(integrator.render(scene, spp=4, seed=seed)) for seed in (1, 2, 1))
    assert (one != other).any()
    np.testing.assert_array_equal(one, again)


def test_normals_that_face_away_give_no_signal():
    scene = load({"object": plane(), "led_0": far((1, 0, 1)), "led_1": near((5, 0, 3))})
    integrator = ring(constant_light=0.05)
    normal = np.broadcast_to([-1, 0, 0.5], (HEIGHT, WIDTH, 3))
    set_textures(integrator, normal=normal, reflectance=np.ones((HEIGHT, WIDTH, 1)))
    np.testing.assert_array_equal(np.array(integrator.render(scene, spp=1)), np.float32(0.05))


def test_normal_of_length_zero_gives_no_signal():
    scene = load(BALL)
    integrator = ring(constant_light=0.05)
    none = np.zeros((HEIGHT, WIDTH, 3))
    set_textures(integrator, normal=none, reflectance=np.ones((HEIGHT, WIDTH, 2)))
    np.testing.assert_array_equal(np.array(integrator.render(scene, spp=1)), np.float32(0.05))


@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH, 3), (HEIGHT, WIDTH - 1, 2)])
def test_textures_of_the_wrong_shape(shape):
    integrator = ring()
    set_textures(integrator, normal=np.ones((HEIGHT, WIDTH, 3)), reflectance=np.ones(shape))
    with pytest.raises(ValueError, match=r"reflectance \(H, W, 2\), got \(12, 16, 3\) and"):
        integrator.render(load(BALL), spp=1)


def test_gradients_equal_finite_differences():
    checks = compare(size=24)
    assert {(c.parameter, c.route) for c in checks} == {
        (parameter, route)
        for parameter in ("normal", "reflectance", "constant_light")
        for route in ("dr.backward", "render_backward")
    }
    for check in checks:
        bound = 2e-3 if check.parameter == "normal" else 1e-3
        assert np.count_nonzero(check.finite) > 0.2 * len(check.finite)
        assert check.relative_error <= bound, check.parameter
        assert check.largest_error <= bound, check.parameter


def test_rendering_keeps_no_scene_alive():
    freed = []

    class Watched(RingIntegrator):
        def __del__(self):
            freed.append(1)

    mi.register_integrator("watched_ring", lambda props: Watched(props))
    scene = load(BALL | {"integrator": {"type": "watched_ring"}})
    ones = np.ones((HEIGHT, WIDTH, 3))
    set_textures(scene.integrator(), normal=ones, reflectance=ones[..., :2])
    scene.integrator().render(scene, spp=1)
    del scene
    assert freed == [1]
