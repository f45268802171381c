"""Values of a scene's parameters: the same again, others once something has changed."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from evsdr.integrators.values import is_of_led, is_of_scene, values_of

from tests.support.ring_scenes import diffuse, far, load, near, peak, soft

SCENE = {
    "integrator": {"type": "ring"},
    "object": {"type": "sphere", "bsdf": diffuse(0.5)},
    "led_0": far((1, 0.2, 1), peak(460)),
    "led_1": near((-1, 1, 2.5), peak(600)),
    "led_2": soft((0, -1, 3), 0.2, peak(600)),
}
CHANGES = {
    "led_0.to_world": lambda v: mi.Transform4f().rotate([0, 1, 0], 5.0) @ v,
    "led_0.irradiance.values": lambda v: 1.01 * v,
    "led_1.position": lambda v: v + mi.Vector3f(0, 0, 1e-3),
    "led_2.emitter.radiance.values": lambda v: v + 1e-3,
    "object.to_world": lambda v: mi.Transform4f().translate([0.1, 0, 0]) @ v,
    "camera.film.crop_size": lambda v: v - 1,
}


def test_nothing_has_changed():
    scene = load(SCENE)
    assert values_of(scene) == values_of(scene)
    assert values_of(scene) != values_of(load(SCENE)) and values_of(scene) != ()


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_is_seen(name):
    scene = load(SCENE)
    before = [values_of(scene, chosen) for chosen in (is_of_scene, is_of_led)]
    params = mi.traverse(scene)
    params[name] = CHANGES[name](params[name])
    params.update()
    after = [values_of(scene, chosen) for chosen in (is_of_scene, is_of_led)]
    assert after[0] != before[0]
    assert (after[1] != before[1]) == name.startswith("led")


def test_arrays_are_held_so_that_none_takes_their_place():
    scene, name = load(SCENE), "led_0.irradiance.values"
    seen = []
    for k in range(20):
        params = mi.traverse(scene)
        params[name] = mi.Float(np.full(dr.width(params[name]), 0.01 * (k + 1), np.float32))
        params.update()
        assert values_of(scene, is_of_led) not in seen
        seen.append(values_of(scene, is_of_led))


def test_the_integrators_own_parameters_do_not_count():
    scene = load(SCENE)
    before, params = values_of(scene, is_of_scene), mi.traverse(scene)
    params["integrator.constant_light"] = mi.Float(0.3)
    params.update()
    assert values_of(scene, is_of_scene) == before
