"""Maps follow what pixels share, if that moves them."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects.effect import Decision
from evsdr.effects.shared import SharedFound
from evsdr.effects.world import Fitted, Terms
from evsdr.fitting import deciding, sharing
from evsdr.progress import silent

TERMS = Terms(shared=("lag",), limit_deg=0.05)


@dataclass(frozen=True)
class World:
    """With what is told and what is found."""

    terms: Terms = TERMS
    recording: str = "told"
    lag: str = "none"
    leak: str = "none"
    aim: str = "none"
    nearer: float = 0.0
    found: object = None
    decisions: dict = field(default_factory=dict)

    def problem(self, fitted):
        return "problem", self.lag, fitted.seen

    def with_seen(self, fitted):
        return replace(fitted, seen=f"under {self.lag}")


@dataclass(frozen=True)
class Maps:
    """A solution that remembers by what it was moved."""

    by: float = 0.0

    def moved(self, by):
        return replace(self, by=self.by + by[2])


def found(turned_deg, scale):
    moved = np.array([9.0, 9.0, scale, 0.0])  # slopes of the median pixel say nothing
    return SimpleNamespace(inferred=SimpleNamespace(moved_deg=turned_deg), moved=moved)


@pytest.mark.parametrize(
    "decided, answer, fits",
    [
        (True, found(0.0, 0.0), True),
        (True, None, True),
        (False, found(0.09, 0.019), False),
        (False, found(0.11, 0.0), True),
        (False, found(0.0, -0.021), True),
        (False, None, False),
    ],
)
def test_another_fit_where_it_moves_maps(monkeypatch, decided, answer, fits):
    monkeypatch.setattr(deciding, "decide", lambda when, world, *_: (replace(world, lag="found"), decided))
    taught = []

    def find_shared(world, teacher):
        taught.append(teacher.problem)
        return answer

    monkeypatch.setattr(sharing, "find_shared", find_shared)
    told, begun = World(), World(lag="before")
    world, fitted, again = sharing.share_anew(told, begun, Fitted(None, Maps(), None), None, silent)
    told_light = "problem", "none", "under none"  # hidden LEDs are looked for once, under what was told
    assert again == fits and taught == [told_light] and (fitted.seen == "under none") == fits
    assert world.lag == ("found" if fits else "before")
    assert fitted.solution.by == (answer.moved[2] if fits and answer else 0)


def test_it_starts_from_what_was_found_last_whose_maps_these_are(monkeypatch):
    """Whose own bias is that of the light before."""
    monkeypatch.setattr(deciding, "decide", lambda when, world, *_: (replace(world, lag="found"), False))
    last = SharedFound("rig", ("tau",), None, 0.0, 1.0, off=np.ones(1))
    first = replace(last, inferred="an earlier rig")
    decisions = {"LEDs": Decision("LEDs", True, "", answer="light")}
    decisions |= {name: Decision(name, True, "", answer=of) for name, of in (("a", first), ("b", last))}
    begun, started = World(found=first, decisions=decisions), []
    monkeypatch.setattr(sharing, "find_shared", lambda world, teacher: started.append(world.found))
    for world in (begun, World()):
        sharing.share_anew(World(), world, Fitted(None, Maps(), None), None, silent)
    assert started == [replace(last, off=None), None]


def test_who_stops_keeps_what_was_believed(monkeypatch):
    monkeypatch.setattr(deciding, "decide", lambda when, world, *_: (world, False))
    monkeypatch.setattr(sharing, "find_shared", lambda *_: pytest.fail("inferred"))
    begun, fitted = World(lag="before"), Fitted(None, Maps(), None)
    assert sharing.share_anew(World(), begun, fitted, None, silent) == (begun, fitted, False)
