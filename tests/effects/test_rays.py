"""Rays for visibility: as many as their chance demands."""

from dataclasses import replace

import pytest

from evsdr.effects.rays import SHARE, Rays, RaysOnFit
from tests.support.worlds import load, with_ball, world_of


@pytest.mark.parametrize(("limit_deg", "rays"), [(75.0, 4), (2.5e-3, 16)])
def test_rays_follow_the_chance_they_leave(tmp_path, limit_deg, rays):
    """Shadow edges in few pixels of many need more rays than none."""
    world = world_of(load(tmp_path, with_ball(0.7)), limit_deg=limit_deg, most_rays=16)
    world = replace(world, shadows="scene")
    decision = Rays().decide("auto", world, None)
    assert decision.found["rays"] == rays and decision.why.startswith(f"{rays}: 4 leave ")
    assert decision.modelled == (rays > 4) and decision.expected_deg > 0
    assert decision.why.endswith("the preset allows no more") == (rays == 16)
    assert Rays().model(world, decision).rays == rays


@pytest.mark.parametrize(("ratio", "rays"), [(0.9, 4), (2.0, 16), (6.0, 64)])
def test_chance_falls_with_the_power_three_quarters(tmp_path, ratio, rays):
    """An error twice too large needs 4 * 2^(4/3) = 10 rays, one six times too large 44."""
    ring = load(tmp_path, with_ball(0.7))
    error = Rays().decide("auto", replace(world_of(ring), shadows="scene"), None).expected_deg
    world = world_of(ring, limit_deg=error / ratio / SHARE, most_rays=64)
    assert Rays().decide("auto", replace(world, shadows="scene"), None).found["rays"] == rays


def test_no_shadow_needs_no_rays(tmp_path):
    decision = Rays().decide("auto", world_of(load(tmp_path, with_ball(9))), None)
    assert not decision.modelled and "no visibility is sampled" in decision.why


def test_on_a_fit_they_are_as_many_as_may_be(tmp_path):
    world = world_of(load(tmp_path, with_ball(9)), most_rays=64)
    assert RaysOnFit().decide("auto", world, None) is None
    assert RaysOnFit().decide("auto", replace(world, shadows="estimate"), None).found == {"rays": 64}
