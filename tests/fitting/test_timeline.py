"""The plan of a fit names what a fit goes through, in order."""

import re

import pytest

from evsdr.fitting.deciding import EFFECTS
from evsdr.fitting.entrance import SOLVE
from evsdr.fitting.timeline import FIT, plan_of
from tests.conftest import REPOSITORY


def test_stages_are_those_of_the_command_and_the_story():
    files = [REPOSITORY / "evsdr" / name for name in ("commands/fit.py", "fitting/story.py")]
    text = "".join(file.read_text() for file in files).replace("stage(SOLVE)", f'stage("{SOLVE}")')
    assert list(FIT.stages) == re.findall(r'stages\.stage\("([\w ]+)"\)', text)


def test_parts_are_those_of_the_effects_and_the_solver():
    decided = {f"decide on {effect.name}" for effect in EFFECTS}
    solver = "".join(file.read_text() for file in (REPOSITORY / "evsdr" / "solve").rglob("*.py"))
    for name in FIT.parts:
        assert name in decided or f'"{name}"' in solver, name


@pytest.mark.parametrize(
    "known, fast, later", [(True, False, False), (False, False, True), (False, True, True)]
)
def test_where_the_shape_is_unknown_the_light_takes_longer(known, fast, later):
    plan = plan_of(known, fast)
    assert list(plan.stages) == list(FIT.stages)
    assert (plan.stages["settle light"] > FIT.stages["settle light"]) == later
