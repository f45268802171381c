"""Cast shadows are traced where they fall on the object, and as `--shadows` asks."""

from dataclasses import replace

import drjit as dr
import pytest

from evsdr.effects.shadows import Shadows, ShadowsOnFit
from evsdr.light.scene import load_scene
from tests.conftest import REPOSITORY
from tests.support.worlds import load, with_ball, world_of


@pytest.mark.parametrize(("distance", "traced"), [(0.7, True), (9.0, False)])
def test_auto_traces_shadows_that_fall_on_the_object(tmp_path, distance, traced):
    world = world_of(load(tmp_path, with_ball(distance)))
    decision = Shadows().decide("auto", world, None)
    assert decision.modelled == traced == (decision.expected_deg > world.terms.limit_deg)
    assert (decision.found["blocked"] > 0) == traced
    begins = "traced on the scene's geometry: " if traced else "not modelled: no (pixel, LED)"
    assert decision.why.startswith(begins)


def test_another_limit_decides_otherwise(tmp_path):
    world = world_of(load(tmp_path, with_ball(0.7)), limit_deg=30.0)
    decision = Shadows().decide("auto", world, None)
    assert not decision.modelled and "less than 30" in decision.why


def test_auto_traces_nothing_on_a_sphere():
    world = world_of(load_scene(REPOSITORY / "scenes" / "sphere.xml", {"size": "32"}))
    decision = Shadows().decide("auto", world, None)
    assert not decision.modelled and decision.expected_deg == 0
    assert all(dr.width(e) == 1 for e in world.illumination().irradiance)


def test_modelled_shadows_are_in_the_light(tmp_path):
    world = world_of(load(tmp_path, with_ball(0.7)))
    shadowed = Shadows().model(world, None).illumination()
    assert min(float(dr.min(e)[0]) for e in shadowed.irradiance) == 0
    assert min(float(dr.min(e)[0]) for e in world.illumination().irradiance) > 0


@pytest.mark.parametrize("asked", ["off", "scene", "estimate", "downweight"])
def test_what_is_asked_for_is_done(tmp_path, asked):
    decision = Shadows().decide(asked, world_of(load(tmp_path, with_ball(9))), None)
    assert decision.modelled == (asked == "scene") and decision.why.endswith(f"--shadows {asked}")


def test_a_known_shape_casts_no_estimated_shadow(tmp_path):
    world = world_of(load(tmp_path, with_ball(0.7)))
    assert ShadowsOnFit().decide("auto", world, None) is None
    assert ShadowsOnFit().decide("off", replace(world), None) is None
