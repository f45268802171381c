"""Recipes: what each purpose goes through."""

import pytest

from evsdr.solve import recipes
from evsdr.solve.learning import Neighbours, PixelNoise
from evsdr.solve.neighbours.posterior import Priors
from evsdr.solve.recipes import Effort
from evsdr.solve.stages import AllPairs

ALL = (
    recipes.whole,
    recipes.after_light,
    recipes.after_events,
    recipes.after_model,
    recipes.quick,
    recipes.refine,
    recipes.rough,
)


@pytest.mark.parametrize("recipe", ALL)
def test_recipes_end_by_saying_how_well_pixels_are_known(recipe):
    """On all events, with one tolerance."""
    stages = recipe(Effort().at(0.3))
    assert isinstance(stages[-2], PixelNoise) and isinstance(stages[-1], Neighbours)
    assert sum(isinstance(stage, AllPairs) for stage in stages) == 1
    assert {stage.tolerance for stage in stages if hasattr(stage, "tolerance")} == {0.3}


def test_a_rough_start_hears_no_neighbours():
    stages = recipes.rough(Effort())
    assert isinstance(stages[-2], PixelNoise) and stages[-1].priors is None


@pytest.mark.parametrize("recipe", [recipes.touch, recipes.search])
def test_what_shows_how_photoreceptors_lag_hears_early_events_and_no_neighbours(recipe):
    stages = recipe(Effort())
    assert not any(isinstance(stage, AllPairs) for stage in stages) and stages[-1].priors is None


@pytest.mark.parametrize("recipe", [recipes.sketch, recipes.sketch_after_light])
def test_a_sketch_hears_early_events_and_neighbours(recipe):
    stages = recipe(Effort())
    assert not any(isinstance(stage, AllPairs) for stage in stages)
    assert isinstance(stages[-2], PixelNoise) and stages[-1].priors == Effort().priors


def test_the_search_hardens_its_horizon():
    soft, hard = recipes.whole(Effort())[0].stages[:2]
    assert soft.softness > 0.1 and hard.softness is None


def test_tolerance_reaches_the_priors():
    assert Effort(priors=Priors(n_round=3)).at(0.5).priors == Priors(n_round=3, tolerance=0.5)
