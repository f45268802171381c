"""LEDs at finite distance, told from far ones by what their parallax does to normals."""

from dataclasses import replace
from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.effects import shared
from evsdr.effects.effect import Decision
from evsdr.effects.near_leds import DepthOfNearLeds, DistanceOfNearLeds, NearLeds
from evsdr.effects.shared import DistanceOff
from evsdr.effects.world import Terms
from evsdr.rig.led_xml import spectrum_xml, square_led
from evsdr.solve.shared.rig import Told
from tests.support.shared_worlds import FITTED, found, world
from tests.support.small_scene import leds, scene
from tests.support.worlds import load, world_of

PLANE = (
    '<shape type="rectangle" id="object"><transform name="to_world"><scale value="0.8"/></transform></shape>'
)
DISTANCE = 4.0
LED = np.array([1, 0, 1]) * DISTANCE / 2**0.5  # the first one


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


def light_at(world, by, led):
    """Give directions (3, n) and irradiance (n,) of an LED at the pixels of a plane at z = by, and the pixels; in closed form."""
    camera, ring = world.surface.camera, world.ring
    seen = world.mask.ravel()
    x, y, _ = camera.points(np.ones((ring.height, ring.width))).reshape(-1, 3)[seen].T
    way = led[:, None] - np.stack([x, y, np.full(len(x), by)])
    square = np.sum(way**2, axis=0)
    return way / np.sqrt(square), DISTANCE**2 / square, seen


@pytest.mark.parametrize("by", [0.3, -0.2])
def test_a_surface_that_is_nearer_has_other_light(tmp_path, by):
    """That of a point LED on a plane that is moved towards the camera; and what is looked for beside that is the same."""
    world = NearLeds().model(world_of(load(tmp_path, scene(shape=PLANE, light=leds(distance=DISTANCE)))))
    assert world.distance_is_unknown and world.surface.extent == pytest.approx(1.6, abs=0.2)
    moved = DistanceOfNearLeds().model(world, Decision("", True, "", answer=found(distance=by)))
    direction, irradiance, seen = light_at(world, by, LED)
    fitted = SimpleNamespace(
        problem=SimpleNamespace(pixel=np.flatnonzero(seen), pairs=SimpleNamespace(first=mi.UInt32(0)))
    )
    rows = np.arange(len(irradiance))
    here, there = world.illumination().gather(mi.UInt32(np.flatnonzero(seen))), moved.illumination()
    for light in (
        there.gather(mi.UInt32(np.flatnonzero(seen))),
        world.nearer_light(fitted, rows, 0.5)(here, by),
        moved.nearer_light(fitted, rows, 0.5).light[1],
    ):
        np.testing.assert_allclose(np.array(light.direction[0]), direction, atol=0.02)
        np.testing.assert_allclose(light.irradiance[0].numpy(), irradiance, rtol=0.04)
    assert np.abs(here.irradiance[0].numpy() / irradiance - 1).min() > 0.05


def test_no_surface_is_looked_for_behind_leds_that_shine_to_one_side(tmp_path):
    """Square LEDs at a height of 2.8: there is no light at 3 and more."""
    square = square_led("led_000", "light", LED, 0.2) + square_led("led_001", "light", LED * [-1, 1, 1], 0.2)
    light = spectrum_xml(np.array([430.0, 450.0, 470.0]), np.array([0.0, 1.0, 0.0]), id="light") + square
    world = NearLeds().model(world_of(load(tmp_path, scene(shape=PLANE, light=light))))
    seen = np.flatnonzero(world.mask)
    fitted = SimpleNamespace(problem=SimpleNamespace(pixel=seen, pairs=SimpleNamespace(first=mi.UInt32(0))))
    assert world.nearer_light(fitted, np.arange(len(seen)), 1.0).reach == 1.0
    halved = world.nearer_light(fitted, np.arange(len(seen)), 4.0)
    assert halved.reach == 2.0 and halved.is_lit


def test_the_distance_is_unknown_only_of_unknown_shapes_near_leds(tmp_path):
    near = NearLeds().model(world_of(load(tmp_path, scene(light=leds(distance=4)))))
    far = world_of(load(tmp_path, scene(shape=PLANE)))
    assert not near.distance_is_unknown and not far.distance_is_unknown


@pytest.mark.parametrize(
    ("by", "warned", "words"),
    [
        (0.2, False, "0.2 +- 0.01 scene units nearer to the camera than the rectangle"),
        (-1.0, True, "1 +- 0.01 scene units farther from the camera than the rectangle"),
        (0.9, False, "0.9 +- 0.01 scene units nearer to the camera than the rectangle"),
    ],
)
def test_the_distance_is_told(by, warned, words):
    """And warned of where it ends: nothing is looked for beyond twice the tolerance."""
    effect, answer = DistanceOfNearLeds(), found(distance=by, told=Told(distance=0.5))
    assert effect.say(answer) == words and effect.numbers(answer) == {"nearer": by, "nearer_sigma": 0.01}
    assert bool(effect.warning(answer)) == warned and (words in effect.warning(answer)) == warned


def off_by(**values):
    return replace(found(distance=0.1), distance_off=DistanceOff(**values))


@pytest.mark.parametrize(("sigma", "vague"), [(0.09, 0.0), (0.11, 0.5)])
def test_a_distance_may_be_off_by_what_it_moves_and_by_what_it_is_told_to(sigma, vague):
    """The latter where events hardly know it better; here it is told to 0.5."""
    now, last = found(distance=0.3), found(distance=0.1)
    now = replace(now.inferred, sigma=replace(now.inferred.sigma, distance=sigma))
    off = shared._distance_off(now, last, 0.5)
    assert off.moving == pytest.approx(0.2) and off.vague == vague and off.by == max(off.moving, vague)
    assert shared._distance_off(now, None, 0.5).moving == 0


@pytest.mark.parametrize(
    ("terms", "answer", "unknown", "doubt"),
    [
        (Terms(), None, True, "taken from the rectangle"),
        (Terms(), None, False, ""),
        (Terms(thorough=False), found(distance=0.1), True, "from first maps"),
        (Terms(thorough=False), found(distance=0.1), False, ""),
        (Terms(shared=("powers",)), None, True, ""),
        (Terms(), found(distance=0.1), True, ""),
        (Terms(), off_by(moving=0.1, turns_deg=0.9), True, ""),
        (Terms(), off_by(moving=0.1, turns_deg=1.1), True, "moved by 0.1 scene units, which turns"),
        (Terms(), off_by(moving=0.1, vague=0.5, turns_deg=6.0), True, "hardly better than the rectangle"),
    ],
)
def test_a_distance_of_which_events_are_not_asked_well_is_doubtful(
    monkeypatch, terms, answer, unknown, doubt
):
    """But not where a user tells it."""
    monkeypatch.setattr(shared, "find_shared", lambda *_: answer)
    told = world(terms, answer, distance_is_unknown=unknown)
    decision = DistanceOfNearLeds().decide("auto", told, FITTED)
    assert bool(decision.doubt) == bool(doubt) and doubt in decision.doubt
    assert decision.modelled == bool(answer)
