"""Shadows tell a raised surface from a hollow one."""

from evsdr.effects.hollow import Hollow, told_by_shadows
from tests.support.setups import fitted_alone, recorded, scene_of
from tests.support.worlds import world_of


def test_what_shadows_say_of_half_a_turn():
    relief = Hollow(told=-2.22, turned=-2.26, bare=-2.25)
    assert relief.wrong and not relief.doubtful and not relief.open
    found = relief.finding(world_of(scene_of(), recorded()[0]))
    assert found.hypothesis.what == "the image is turned by 180 degrees" and "hollow" in found.evidence
    assert found.others == ("the order of the LEDs is rolled: it starts with 12, 13, 14",)
    right = Hollow(told=-2.26, turned=-2.22, bare=-2.25)
    assert not right.wrong and not right.doubtful and not right.open and right.finding(None) is None
    assert Hollow(told=0.5, turned=-2.2, bare=-2.2).doubtful
    assert Hollow(told=-2.19, turned=-2.197, bare=-2.2).open, "both cast shadows that are not there"
    assert Hollow(told=-1.0, turned=-1.9, bare=-2.2).doubtful, "one of them far more"
    assert Hollow(told=-2.203, turned=-2.21, bare=-2.2).open, "both cast some that are there"


def test_flat_things_are_neither_hollow_nor_raised():
    assert told_by_shadows(*fitted_alone(scene_of("relief_unknown"), recorded("colorchecker")[0])) is None
