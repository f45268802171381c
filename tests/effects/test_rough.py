"""Rough matt surfaces are found, and named."""

from dataclasses import replace
from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.effects import rough
from evsdr.effects.rough import RoughMatt, rough_evidence
from evsdr.effects.world import Fitted, Terms
from evsdr.events.pairs import pair_events
from evsdr.model.lambert import signals_of
from evsdr.model.rough import RoughRing
from evsdr.solve.problem import make_problem
from tests.support.analytic import sphere_normals
from tests.support.glossy import mean_error, sphere
from tests.support.sphere import SPECTRUM, record_signal, ring_light, solve


@pytest.fixture(scope="module")
def worn():
    """A rough sphere, the Lambertian fit of it, and its normals."""
    normal, mask = sphere_normals(24)
    slopes = -normal[mask][:, :2] / np.maximum(normal[mask][:, 2:], 0.05)
    theta = np.column_stack([slopes, np.tile(np.log(SPECTRUM), (len(slopes), 1))])
    signal = np.zeros((24, 24, 24))
    signal[:, mask] = signals_of(RoughRing(ring_light(), mi.Float(1.0)), theta)[:-1]
    recording = record_signal(signal, event_noise=0.05)
    problem = make_problem(recording, pair_events(recording, mask), ring_light(), mask)
    return problem, solve(problem), normal[mask]


def test_it_is_found_and_mends_the_normals(worn):
    problem, lambertian, normal = worn
    found = rough_evidence(problem, lambertian)
    assert found.is_clear and found.roughness == pytest.approx(1, abs=0.15)
    problem = replace(problem, rough=mi.Float(found.roughness))
    error = mean_error(solve(problem, model=problem.model).theta, normal)
    before = mean_error(lambertian.theta, normal)
    assert error < 0.4 * before and found.error_deg == pytest.approx(before - error, rel=0.5)


def test_a_lambertian_one_is_none():
    problem, *_ = sphere(size=24, event_noise=0.05)
    assert not rough_evidence(problem, solve(problem)).is_clear
    silent = replace(problem, pairs=replace(problem.pairs, last=problem.pairs.first))
    assert rough_evidence(silent, solve(problem)).z == 0


def test_it_is_named_once_lobes_are_decided_on(worn, monkeypatch):
    monkeypatch.setattr(rough, "view_directions", lambda *_: None)
    world = SimpleNamespace(terms=Terms(), metal=None, gloss=None, ring=None, decisions={"gloss": None})
    decision = RoughMatt().decide("auto", world, Fitted(*worn[:2], None))
    assert decision.modelled and "brighter than a matt one where light or view graze" in decision.warning
    world.decisions = {}
    assert RoughMatt().decide("auto", world, None) is None
    for asked, terms in (("off", Terms()), ("auto", Terms(thorough=False))):
        world = SimpleNamespace(terms=terms, metal=None, gloss=None, decisions={"gloss": None})
        assert "not looked for" in RoughMatt().decide(asked, world, None).why


def test_in_haste_it_is_looked_for_under_lobes_alone(worn, monkeypatch):
    monkeypatch.setattr(rough, "view_directions", lambda *_: None)
    world = SimpleNamespace(terms=Terms(thorough=False), metal=None, ring=None, decisions={"gloss": None})
    for gloss, looked in ((None, False), ("a lobe", True)):
        world.gloss = gloss
        assert RoughMatt().decide("auto", world, Fitted(*worn[:2], None)).modelled == looked
