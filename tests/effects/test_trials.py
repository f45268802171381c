"""Hypotheses are tried on the events of some pixels."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.effects.hypotheses import clocks, images, polarities
from evsdr.effects.trials import Trial, cauchy, chosen, of_pixels, try_all
from tests.support.setups import SIZE, fitted_alone, recorded, scene_of


@pytest.fixture(scope="module")
def given():
    return fitted_alone(scene_of(), recorded()[0])


def test_the_scale_that_fits_best(rng):
    u = 0.05 * rng.standard_cauchy(20_000)
    cost, scale = cauchy(u)
    assert scale == pytest.approx(0.05, rel=0.06)
    assert cost == pytest.approx(np.log(4 * 0.05), abs=0.03)  # its entropy, less log pi


def test_what_is_told_right_explains_most(given):
    world, fitted = given
    pixel = chosen(world, fitted, [])
    listed = [*clocks(world.recording), *polarities()]
    tried = {h: try_all(world, fitted, pixel, [h])[h] for h in (None, *listed) if not h or "ns" not in h.what}
    told = tried.pop(None)
    assert told.normal.shape == (len(pixel), 3) and told.gain is None
    np.testing.assert_array_equal(told.place, pixel)
    assert told.lost < 0.02
    assert all(told.cost < trial.cost - 0.2 for trial in tried.values())


def test_pixels_go_where_the_image_goes(given):
    world, fitted = given
    flip = next(images(world.recording))
    pixel = chosen(world, fitted, [flip.move])
    trial = try_all(world, fitted, pixel, [flip])[flip]
    row, column = np.divmod(pixel, SIZE)
    np.testing.assert_array_equal(trial.place, np.sort(row * SIZE + SIZE - 1 - column))


def test_pixels_that_would_leave_the_object_are_not_chosen(given):
    world, fitted = given
    half = fitted.problem.grid.mask & (np.arange(SIZE) < SIZE // 2 + 4)
    problem = replace(fitted.problem, grid=replace(fitted.problem.grid, mask=half))
    column = chosen(world, replace(fitted, problem=problem), [np.fliplr]) % SIZE
    assert column.min() >= SIZE // 2 - 4 and column.max() < SIZE // 2 + 4
    beside = fitted.problem.grid.mask & (np.arange(SIZE) < SIZE // 2 - 2)
    problem = replace(fitted.problem, grid=replace(fitted.problem.grid, mask=beside))
    assert len(chosen(world, replace(fitted, problem=problem), [np.fliplr])) > 50


def test_only_some_pixels_count(given):
    world, _ = given
    events = of_pixels(world, np.array([SIZE * 12 + 7])).recording.events
    assert len(events) > 10 and set(events.x) == {7} and set(events.y) == {12}


def test_the_share_of_what_is_lost():
    trial = Trial(0.0, 1.0, np.array([0.1, -0.6, 0.4, 2.0]), np.arange(2), np.zeros((2, 3)), None)
    assert trial.lost == 0.5


def test_under_which_nothing_pairs_is_left_out(given):
    """In ns all events are told to fall into the first slot, most within the refractory period."""
    world, fitted = given
    told = replace(world.recording.events, t=np.zeros_like(world.recording.events.t))
    silent = replace(world, recording=replace(world.recording, events=told))
    tried = try_all(silent, fitted, chosen(silent, fitted, []), [None, *polarities()])
    assert list(tried) == [None] and tried[None].lost == 1 and tried[None].scale == pytest.approx(1, rel=0.1)
