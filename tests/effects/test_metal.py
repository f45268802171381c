"""What a fit decides on metal."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest

from evsdr.effects import metal
from evsdr.effects.metal import Metal, RoughnessOfMetal
from evsdr.effects.metal_fit import MetalEvidence
from evsdr.effects.world import Fitted, Terms
from tests.support.glossy import metal_sphere


@dataclass(frozen=True)
class World:
    terms: Terms = Terms()
    thresholds: bool = True
    ring: object = None
    metal: float | None = None
    decisions: dict = field(default_factory=dict)


@pytest.fixture
def fitted(monkeypatch):
    monkeypatch.setattr(metal, "view_directions", lambda *_: None)
    return Fitted(metal_sphere(0.3, size=12)[0], None, None)


def test_metal_replaces_the_matt_surface(fitted):
    decision = Metal().decide("auto", World(), fitted)
    assert decision.modelled and "looks like metal of roughness" in decision.warning
    assert Metal().model(World(), decision).metal == decision.found["alpha"] == decision.answer


def test_its_roughness_is_refined_once(fitted, monkeypatch):
    monkeypatch.setattr(metal, "refine_roughness", lambda *_: 0.25)
    world = World(decisions={"metal": Metal().decide("auto", World(), fitted)})
    refined = RoughnessOfMetal().decide("auto", world, fitted)
    assert refined.answer == 0.25 and refined.why.startswith("roughness 0.25: metal gains")
    assert RoughnessOfMetal().decide("auto", World(decisions={"metal": refined}), fitted) is None


def test_what_contradicts_metal_too_is_none(fitted, monkeypatch):
    monkeypatch.setattr(metal, "metal_evidence", lambda *_: MetalEvidence(0.3, 9.0, 2.0, 0.5))
    decision = Metal().decide("auto", World(), fitted)
    assert not decision.modelled
    assert RoughnessOfMetal().decide("auto", World(decisions={"metal": decision}), fitted) is None


@pytest.mark.parametrize(
    ("asked", "terms", "words"),
    [
        ("off", Terms(), "--gloss off"),
        ("auto", Terms(solver="adam"), "solver adam"),
    ],
)
def test_when_it_is_not_looked_for(asked, terms, words):
    decision = Metal().decide(asked, SimpleNamespace(terms=terms), None)
    assert not decision.modelled and words in decision.why
