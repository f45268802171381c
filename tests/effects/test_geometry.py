"""Geometry that does not fit what was recorded is warned of."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.effects.geometry import MISPLACED_DEG, check_light, check_normals, check_pieces
from evsdr.errors import InputWarning
from evsdr.light.ground_truth import surface_maps
from tests.support.small_scene import DIFFUSE, camera, leds, scene
from tests.support.worlds import load, world_of

PLANE = f"""<shape type="rectangle" id="object"><transform name="to_world"><scale value="3"/></transform>
    {DIFFUSE}</shape>"""
LARGE = camera(width=32, height=32)


def test_leds_that_light_something_are_not_warned_of(tmp_path):
    check_light(world_of(load(tmp_path, scene(light=leds(distance=4), sensor=LARGE))))


@pytest.mark.parametrize(("wrong", "words"), [((2,), "LED 2 lights"), ((2, 5), "LEDs 2, 5 light")])
def test_leds_behind_the_object_are_named(tmp_path, wrong, words):
    lines = leds(distance=4).splitlines()
    for j in wrong:
        lines[j] = lines[j].replace('z="2.828', 'z="-2.828')
    world = world_of(load(tmp_path, scene(shape=PLANE, light="\n".join(lines), sensor=LARGE)))
    with pytest.warns(InputWarning, match=f"scene.xml: {words} no pixel"):
        check_light(world)


def test_leds_behind_a_known_shape_are_named(tmp_path):
    """From there no ray is traced: visibility is not modelled, the normals tell."""
    lines = leds(distance=4).splitlines()
    place, rest = lines[3].index("<point"), lines[3].index("<spectrum")
    lines[3] = f'{lines[3][:place]}<point name="position" x="0" y="0" z="-4"/>{lines[3][rest:]}'
    world = world_of(load(tmp_path, scene(light="\n".join(lines), sensor=LARGE)))
    with pytest.warns(InputWarning, match="LED 3 lights no pixel"):
        check_light(world)


def test_pieces_of_an_unknown_shape(tmp_path):
    world = world_of(load(tmp_path, scene(shape=PLANE, sensor=LARGE)))
    check_pieces(world)
    mask = world.mask.copy()
    mask[:, 15:17] = False
    mask[0, 15] = True  # too small to be a piece, and it touches one
    with pytest.warns(InputWarning, match="seen in 2 pieces"):
        check_pieces(replace(world, mask=mask))


def test_pieces_of_a_known_shape_matter_if_its_depth_is_estimated(tmp_path):
    world = world_of(load(tmp_path, scene(sensor=LARGE)))
    mask = world.mask.copy()
    mask[:, 15:17] = False
    check_pieces(replace(world, mask=mask))
    with pytest.warns(InputWarning, match="2 pieces"):
        check_pieces(replace(world, mask=mask, shadows="estimate"))


@pytest.mark.parametrize(("turn", "warned"), [(MISPLACED_DEG - 3, False), (MISPLACED_DEG + 3, True)])
def test_normals_that_contradict_the_geometry(tmp_path, turn, warned):
    world = world_of(load(tmp_path, scene(sensor=LARGE)))
    maps = surface_maps(world.ring, 1)
    angle = np.radians(turn)
    turned = maps.normal @ np.array(
        [[1, 0, 0], [0, np.cos(angle), np.sin(angle)], [0, -np.sin(angle), np.cos(angle)]]
    )
    maps = replace(maps, normal=turned)
    check_normals(world, maps)  # no light was traced on it
    traced = replace(world, shadows="scene")
    check_normals(replace(world, shadows="estimate"), maps)
    if not warned:
        return check_normals(traced, maps)
    with pytest.warns(InputWarning, match="degrees off those of the object's geometry"):
        check_normals(traced, maps)
