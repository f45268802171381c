"""LEDs at finite distance, told from far ones by what their parallax does to normals."""

import drjit as dr
import numpy as np
import pytest

from evsdr.effects.near_leds import DepthOfNearLeds, NearLeds
from tests.support.small_scene import leds, scene
from tests.support.worlds import load, world_of


@pytest.mark.parametrize(("distance", "near"), [(4, True), (4000, False)])
def test_auto_tells_near_from_far(tmp_path, distance, near):
    world = world_of(load(tmp_path, scene(light=leds(distance=distance))))
    decision = NearLeds().decide("auto", world, None)
    assert decision.modelled == near == (decision.expected_deg > world.terms.limit_deg)
    assert decision.why.startswith(f"8 in 2 bands, {'near' if near else 'far'}: ")
    assert ("less" in decision.why) != near
    world = NearLeds().model(world) if near else world
    assert (dr.width(world.illumination().direction[0]) > 1) == near


def test_directional_leds_are_far(tmp_path):
    decision = NearLeds().decide("near", world_of(load(tmp_path, scene())), None)
    assert not decision.modelled and decision.why == "8 in 2 bands, far: one direction for all pixels"


def test_far_stands_for_near_where_it_may(tmp_path):
    """Asked for, near LEDs become one direction and one irradiance: those of the middle."""
    world = world_of(load(tmp_path, scene(light=leds(distance=4))))
    decision = NearLeds().decide("far", world, None)
    assert not decision.modelled and decision.why.endswith("asked for by --leds far")
    light = world.illumination()
    expected = np.array([1, 0, 1]) / 2**0.5
    got = np.array(light.direction[0]).ravel()
    assert np.degrees(np.arccos(got @ expected)) < 12  # the sphere bulges toward the light
    assert dr.width(light.irradiance[0]) == 1


def test_a_known_shape_has_its_own_depth(tmp_path):
    world = NearLeds().model(world_of(load(tmp_path, scene(light=leds(distance=4)))))
    assert DepthOfNearLeds().decide("auto", world, None) is None
