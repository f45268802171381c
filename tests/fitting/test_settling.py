"""Light and surface in turns; indirect light that explains the events worse is taken back."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest

from evsdr.effects.effect import Decision
from evsdr.effects.world import Fitted, Terms
from evsdr.fitting import settling


@dataclass(frozen=True)
class SmallWorld:
    """Light and problem are nothing but whether indirect light counts."""

    indirect: bool = True
    terms: Terms = Terms()
    decisions: dict = field(default_factory=lambda: {"light paths": Decision("light paths", True, "both")})

    def illumination(self, fitted, rays):
        return self.indirect

    problem = illumination

    def look(self, fitted):
        return None


class Solver:
    """Explains events with a noise for direct light, and another for both."""

    def __init__(self, noise, asked):
        self.noise, self.settings, self.solved = noise, SimpleNamespace(light_paths=asked), []

    def __call__(self, problem, before, purpose, progress):
        self.solved.append(problem)
        return Fitted(problem, SimpleNamespace(noise=self.noise[problem]), None)


@pytest.mark.parametrize(
    ("noise_of_both", "asked", "kept"), [(0.9, "auto", True), (1.1, "auto", False), (1.1, "indirect", True)]
)
def test_indirect_light_must_explain_the_events(monkeypatch, noise_of_both, asked, kept):
    monkeypatch.setattr(settling, "mean_error", lambda look, before, after: float(before != after))
    solve = Solver({False: 1.0, True: noise_of_both}, asked)
    world, fitted, _ = settling.settle(SmallWorld(), True, Fitted(True, None, None), solve, lambda *_: False)
    assert world.indirect == fitted.problem == world.decisions["light paths"].modelled == kept
    assert solve.solved == ([False, True] if asked == "auto" else [])
    assert world.decisions["light paths"].why.endswith("both" if kept else "the events are explained worse")
