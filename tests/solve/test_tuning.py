"""Every number of the tuning reaches a recipe."""

from dataclasses import fields, replace

import pytest

from evsdr.solve import recipes
from evsdr.solve.recipes import Effort
from evsdr.solve.tuning import Tuning

OTHER = dict(
    softness=0.2,
    n_sweep=0,
    n_spread=1,
    wider=1.0,
    density=False,
    silence=False,
    curved=False,
    misfit=30.0,
)


@pytest.mark.parametrize("name", [field.name for field in fields(Tuning)])
def test_a_number_changes_the_solve(name):
    effort = Effort()
    other = replace(effort, tuning=replace(effort.tuning, **{name: OTHER[name]}))
    assert other.tuning != effort.tuning
    assert (recipes.whole(other), other.width(True)) != (recipes.whole(effort), effort.width(True))
