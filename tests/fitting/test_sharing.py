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
from evsdr.solve.shared.rig import Told

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


@dataclass(frozen=True)
class Rig:
    """Powers, and a lag."""

    log_power: np.ndarray
    tau: float


def found(log_power, searched=None):
    rig = Rig(np.array(log_power), 0.02)
    searched = Rig(np.array(searched), 0.03) if searched else None
    inferred = SimpleNamespace(rig=rig)
    return SharedFound(inferred, ("powers", "tau"), Told(), 100.0, 1e4, off=np.ones(3), searched=searched)


def fit_of(noise):
    """Of two pixels, with a scatter."""
    grid = SimpleNamespace(mask=np.ones((1, 2), bool))
    problem = SimpleNamespace(grid=grid, noise=noise)
    return Fitted(problem, SimpleNamespace(noise=noise), None)


def test_powers_far_from_any_rings_run_away():
    assert sharing.ran_away(found([0.3, -0.1])) and sharing.ran_away(found([0.0, -0.3]))
    assert not sharing.ran_away(found([0.2, -0.2])) and not sharing.ran_away(None)


def test_the_next_search_starts_from_powers_as_told_and_all_else_as_found():
    for of, tau in ((found([0.3, 0.0], [0.5, 0.1]), 0.03), (found([0.3, 0.0]), 0.02)):
        start = sharing.with_powers_as_told(of)
        assert not start.searched.log_power.any() and start.searched.tau == tau and start.off is None
        assert start.inferred is of.inferred


@pytest.mark.parametrize(
    ("log_power", "metal", "noise", "anew"),
    [(1.0, None, 0.08, True), (1.0, None, 0.14, False), (0.1, None, 0.08, None), (1.0, "gold", 0.08, None)],
)
def test_powers_that_ran_away_are_asked_of_maps_that_were_begun_anew(
    monkeypatch, log_power, metal, noise, anew
):
    """Under powers as told and all else as found; they stand if their sketches explain the events better."""
    begun, asked = [], []

    @dataclass(frozen=True)
    class Lit(World):
        metal: object = None
        mask: object = None

        def problem(self, fitted):
            return SimpleNamespace(grid=fitted.problem.grid, world=self)

    def decide(when, world, teacher, *_):
        asked.append((world, teacher))
        return replace(world, lag="found", aim=f"powers {len(asked)}"), True

    def solve(problem, before, purpose, _):
        if purpose == "rough":
            begun.append((problem.world, before))
            return fit_of(0.2)
        return fit_of(noise if begun else 0.13)

    monkeypatch.setattr(deciding, "decide", decide)
    monkeypatch.setattr(sharing, "find_shared", lambda world, teacher: found([log_power, 0.0]))
    monkeypatch.setattr(sharing, "moved_with", lambda found, fitted: fitted)
    told, teacher = Lit(metal=metal), fit_of(0.3)
    look = sharing.Sketcher(None, solve, silent).look(told, teacher)
    assert look.anew == bool(anew) and look.world.aim == f"powers {1 + bool(anew)}"
    assert look.noise == (noise if anew else 0.13)
    if anew is None:
        assert not begun and len(asked) == 1
        return
    (world, before), (again, maps) = begun[0], asked[1]
    assert before is None and world.aim == told.aim and world.lag == "found"
    assert not again.found.searched.log_power.any() and again.lag == told.lag
    assert maps.problem is teacher.problem and maps.solution.noise == 0.2
    assert look.next[0].found is look.found and look.next[1].problem is look.before.problem


def test_nothing_is_inferred_for_who_stopped(monkeypatch):
    monkeypatch.setattr(deciding, "decide", lambda when, world, *_: (world, False))
    monkeypatch.setattr(sharing, "find_shared", lambda *_: pytest.fail("inferred"))
    teacher = fit_of(0.3)
    look = sharing.Sketcher(None, None, silent).look(World(), teacher)
    assert look.after is None and look.before is teacher and look.noise == np.inf
