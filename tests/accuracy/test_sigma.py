"""Sigmas are true: the fast part of `python -m experiments.sigma`, and twins whose sigmas are not."""

import warnings
from functools import cache

import numpy as np
import pytest

import evsdr
from experiments.sigma.cases import chosen, make
from experiments.sigma.compute import Row, errors_of
from experiments.sigma.statistics import PROMISED, level_of_each

SIZE, SEEDS = 28, range(40, 43)
CHANCE = 0.03  # of shares of so few pixels
# Cases that hold, what of them, and what part of sigmas they need, on event pixels by other physics: sigmas that hold what models lack elsewhere are
# 1.4 and 1.3 times what a plain sphere's need be (73 98 100 and 73 95 99 % within 1 2 3 of these parts, p .2 and .5). The experiment tells of all
HOLD = (("sphere/foreign", "angle", 0.7), ("sphere/foreign", "reflectance", 0.75))


@cache
def fitted(name: str) -> list:
    """Give maps, truths and seeds of some recordings of a case."""
    (case,), out = chosen(name), []
    for seed in SEEDS:
        told, recording, truth = make(case, SIZE, seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", evsdr.InputWarning)  # not all is told as it is
            out.append((evsdr.fit(told, recording).maps, truth, seed))
    return out


def row(name: str, factor: float) -> Row:
    """Compare with the truth, with all sigmas multiplied by a factor."""
    return Row(name, tuple(errors_of(*one, factor=factor) for one in fitted(name)))


@pytest.mark.parametrize(("name", "of", "part"), HOLD)
def test_sigmas_are_true_and_their_twins_are_not(name, of, part):
    true, half, double = (row(name, factor * part) for factor in (1.0, 0.5, 2.0))
    level = level_of_each(2 * len(HOLD))  # of three seeds p is coarse
    assert true.mean("known") > 0.98
    assert np.all(true.within(of) > PROMISED - CHANCE)
    assert true.test(of).p > level
    assert half.test(of).p < level and double.test(of).p < level


def test_patches_of_one_colour_are_no_crowd_of_draws():
    """Charts under an EVK4: were each of their pixels a draw of the scene's colours, normals would be 0.49 degrees off, and 53 %
    within one sigma. Three recordings, as one may have 0.18 to 0.38."""
    scene, errors, within = evsdr.load_scene("scenes/colorchecker.xml", size=40), [], []
    for seed in (2, 3, 4):
        recording, truth = evsdr.simulate(scene, seed=seed, thresholds="nominal")
        maps = evsdr.fit(scene, recording).maps
        error = evsdr.angular_error_deg(maps.normal[maps.mask], truth.normal[maps.mask])
        errors.append(error.mean())
        within.append(np.mean(error < maps.normal_sigma_deg[maps.mask]))
    assert np.mean(errors) < 0.35  # .258
    assert np.mean(within) > 0.8  # .86
