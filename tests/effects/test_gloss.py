"""What a fit decides on gloss: matt, coated, and told to leave it."""

import re
from dataclasses import replace
from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.effects import gloss
from evsdr.effects.gloss import LOBE_ERROR, GlossyLobes, find_gloss, lobe_error, seek
from evsdr.effects.gloss_fit import GlossEvidence
from evsdr.effects.world import Terms
from tests.support.glossy import KINDS, mean_error, sphere
from tests.support.sphere import solve


@pytest.fixture(scope="module")
def coated():
    problem, normal, _, _ = sphere([KINDS[1]])
    return problem, normal, solve(problem)


def glossy(problem, decision, solution):
    """Solve with the lobes that were decided on."""
    problem = replace(problem, lobe=decision.answer.lobe(mi.Float))
    return solve(problem, start=[mi.Float(c) for c in solution.theta.T], model=problem.model)


def test_a_matt_surface_stays_as_it_is():
    problem, _, _, _ = sphere(size=32)
    decision = find_gloss("auto", problem, solve(problem), 0.05)
    assert not decision.modelled and decision.why.startswith("not modelled: the residuals show")


def test_a_coating_is_found_and_mends_the_normals(coated):
    problem, normal, matt = coated
    decision = find_gloss("auto", problem, matt, 0.05)
    assert decision.modelled and decision.expected_deg > 0.05
    assert decision.why.startswith("rough dielectric coating, alpha") and "would cost" in decision.why
    solution = glossy(problem, decision, matt)
    assert mean_error(solution.theta, normal) < 0.6 * mean_error(matt.theta, normal)
    refined = find_gloss("auto", problem, solution, 0.05, decision)
    assert refined.expected_deg == decision.expected_deg
    assert refined.found["alpha"] == pytest.approx(decision.found["alpha"], rel=0.2)


@pytest.mark.parametrize("before", [False, True])
def test_lobes_of_no_strength_are_none(coated, monkeypatch, before):
    """They were told by all pixels, or by a matt fit. A fit that had them goes back to what it believed before."""
    problem, _, matt = coated
    found = find_gloss("auto", problem, matt, 0.05)
    none = replace(found.answer, strength=np.zeros_like(found.answer.strength))
    monkeypatch.setattr(gloss, "fit_gloss", lambda *_: none)
    decision = find_gloss("auto", problem, matt, 0.05, found if before else None)
    assert not decision.modelled and decision.taken_back == before
    assert decision.why.startswith("not modelled") and decision.answer is None
    asked_for = find_gloss("lobe", problem, matt, 0.05, found if before else None)
    assert asked_for.modelled and "of no strength: asked for" in asked_for.why and not asked_for.taken_back


@pytest.mark.parametrize(
    "z, n_pixel, asked",
    [
        ((0.5,), 9999, [120]),  # none
        ((5.0,), 9999, [120]),  # clear
        ((2.0, 3.5), 9999, [120, 400]),
        ((2.0, 2.9, 5.0), 9999, [120, 400, 1600]),
        ((2.0, 2.9), 400, [120, 400]),  # there are no more
        ((2.0, 2.9), 100, [120]),
    ],
)
def test_more_pixels_are_asked_until_it_is_clear(monkeypatch, z, n_pixel, asked):
    answers, said = iter(z), []

    def answer(problem, matt, most):
        said.append(most)
        return GlossEvidence(0.1, 0.2, next(answers), 1.0)

    monkeypatch.setattr(gloss, "gloss_evidence", answer)
    counts = np.r_[np.ones(n_pixel, int), np.zeros(5000, int)]  # those that fired nothing are none to ask
    problem = SimpleNamespace(pairs=SimpleNamespace(counts=counts))
    assert seek(problem, ("a fit",), 0.05, 120).z == z[len(asked) - 1] and said == asked


def test_what_turns_nothing_is_not_asked_again(monkeypatch):
    answers = iter([GlossEvidence(0.1, 0.2, 2.0, 0.01)])
    monkeypatch.setattr(gloss, "gloss_evidence", lambda *_: next(answers))
    problem = SimpleNamespace(pairs=SimpleNamespace(counts=np.ones(9999, int)))
    assert seek(problem, (), 0.05, 120).error_deg == 0.01


def test_the_published_lobe_on_request():
    kind, shape, strength = KINDS[0]
    problem, normal, _, _ = sphere([KINDS[0]])
    matt = solve(problem)
    decision = find_gloss("blinn-phong", problem, matt, 0.05)
    found = re.fullmatch(
        r"Blinn-Phong lobe, shininess (\S+) strength ([^:,]+)(?:, on \d+% of the pixels)?: asked for by --gloss blinn-phong",
        decision.why,
    )
    assert float(found[1]) == pytest.approx(shape, rel=0.1)
    assert float(found[2]) == pytest.approx(strength, rel=0.1)
    assert mean_error(glossy(problem, decision, matt).theta, normal) < 0.6 * mean_error(matt.theta, normal)


@pytest.mark.parametrize(
    ("asked", "terms", "words"),
    [
        ("off", Terms(), "asked for by --gloss off"),
        ("auto", Terms(solver="adam", thorough=False), "as published"),
    ],
)
def test_when_no_gloss_is_looked_for(asked, terms, words):
    world = SimpleNamespace(decisions={}, terms=terms, metal=None)
    decision = GlossyLobes().decide(asked, world, None)
    assert not decision.modelled and words in decision.why
    world.decisions["gloss"] = decision
    assert GlossyLobes().decide(asked, world, None) is None


def test_lobes_of_another_form_leave_a_share_of_what_gloss_does():
    change = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, -0.1]])
    found = lobe_error(change)
    assert not found[0].any()
    np.testing.assert_allclose(np.sqrt(np.diagonal(found[1])), LOBE_ERROR * np.abs(change[1]))
    assert found[1, 0, 2] < 0
