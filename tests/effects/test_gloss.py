"""What a fit does about gloss: matt, coated, and told to leave it."""

import re

import pytest

from evsdr.effects.gloss import solve_gloss
from evsdr.solve import levenberg
from tests.support.glossy import KINDS, mean_error, sphere
from tests.support.sphere import solve

ALONE = levenberg.Effort(priors=None)


@pytest.fixture(scope="module")
def coated():
    problem, normal, _, _ = sphere([KINDS[1]])
    return problem, normal, solve(problem)


def test_a_matt_surface_stays_as_it_is():
    problem, _, _, _ = sphere(size=32)
    matt = solve(problem)
    solution, note = solve_gloss("auto", problem, matt, ALONE)
    assert solution is matt and note.startswith("not modelled: the residuals show")


def test_off_leaves_gloss_alone(coated):
    problem, _, matt = coated
    solution, note = solve_gloss("off", problem, matt, ALONE)
    assert solution is matt and "--gloss off" in note


def test_a_coating_is_found_and_mends_the_normals(coated):
    problem, normal, matt = coated
    solution, note = solve_gloss("auto", problem, matt, ALONE)
    assert note.startswith("rough dielectric coating, alpha") and "would cost" in note
    assert mean_error(solution.theta, normal) < 0.6 * mean_error(matt.theta, normal)
    assert solution.n_step > matt.n_step


def test_the_published_lobe_on_request():
    kind, shape, strength = KINDS[0]
    problem, normal, _, _ = sphere([KINDS[0]])
    matt = solve(problem)
    solution, note = solve_gloss("blinn-phong", problem, matt, ALONE)
    found = re.fullmatch(
        r"Blinn-Phong lobe, shininess (\S+) strength (\S+): asked for by --gloss blinn-phong", note
    )
    assert float(found[1]) == pytest.approx(shape, rel=0.1)
    assert float(found[2]) == pytest.approx(strength, rel=0.1)
    assert mean_error(solution.theta, normal) < 0.6 * mean_error(matt.theta, normal)


def test_the_gate_counts_highlights_less(coated):
    problem, normal, matt = coated
    solution, note = solve_gloss("gate", problem, matt, ALONE)
    assert "angular gate" in note
    assert mean_error(solution.theta, normal) < mean_error(matt.theta, normal)
