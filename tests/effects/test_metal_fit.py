from dataclasses import replace

import mitsuba as mi
import pytest

from evsdr.effects.metal_fit import metal_evidence, refine_roughness
from evsdr.solve.recipes import rough_metal
from tests.support.glossy import KINDS, mean_error, metal_sphere, sphere
from tests.support.sphere import ALONE, solve


@pytest.mark.parametrize("roughness", [0.12, 0.3])
def test_metal_is_found_with_its_roughness(roughness):
    problem, _ = metal_sphere(roughness)
    evidence = metal_evidence(problem, True)
    assert evidence.is_clear and evidence.z > 5
    assert (
        0.5 < evidence.roughness / roughness < 2
    )  # of those that are tried, which lie apart; `refine_roughness` mends it


@pytest.mark.parametrize("lobes", [[], [KINDS[1]]])
def test_what_has_a_matt_part_is_no_metal(lobes):
    evidence = metal_evidence(sphere(lobes, size=24)[0], True)
    assert evidence.z < -3 and not evidence.is_clear


def test_pixels_that_do_not_fire_are_no_metal():
    problem, _ = metal_sphere(0.3, size=12)
    silent = replace(problem, pairs=replace(problem.pairs, last=problem.pairs.first))
    assert not metal_evidence(silent, True).is_clear


def test_fitted_as_metal_its_normals_are_found():
    problem, normal = metal_sphere(0.3)
    problem = replace(problem, metal=mi.Float(0.36))
    solution = solve(problem, model=problem.model, recipe=rough_metal(ALONE))
    inner = normal[:, 2] > 0.7
    assert mean_error(solution.theta[inner], normal[inner]) < 6  # as matt 40
    assert refine_roughness(problem, solution) == pytest.approx(0.3, rel=0.05)
