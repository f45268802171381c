"""Recipes: which stages a solve goes through, by what it is for and how hard it shall try."""

from dataclasses import dataclass, replace

from evsdr.solve.neighbours.posterior import Priors
from evsdr.solve.stages import (
    Descend,
    HearAll,
    Neighbours,
    PixelNoise,
    Respread,
    SoftHorizon,
    Stage,
    Starts,
    ThresholdSpread,
)

MOST = 30  # steps of a descent: those that have not settled then never will
WIDER = 1.5  # width of the Cauchy cost where thresholds are unknown: the tails of the residuals tell of them


@dataclass(frozen=True)
class Effort:
    """How hard to try.

    Attributes
    ----------
    tolerance : float
        Gain in log likelihood of a pixel that is worth a step.
    n_heard : int
        Events of a pixel that count until the last stages.
    n_most : int, optional
        Events of a pixel that count at all.
    robust : float
        Width of the Cauchy cost in standard deviations, where thresholds are known.
    priors : Priors, optional
        What pixels tell of each other; None leaves each alone.
    """

    tolerance: float = 0.1
    n_heard: int = 64
    n_most: int | None = None
    robust: float = 2.0
    priors: Priors | None = Priors()

    def at(self, tolerance: float) -> "Effort":
        """Try as hard as a tolerance asks."""
        priors = self.priors and replace(self.priors, tolerance=tolerance)
        return replace(self, tolerance=tolerance, priors=priors)

    def width(self, thresholds: bool) -> float:
        """Give the width of the Cauchy cost, with thresholds unknown or not."""
        return self.robust * (WIDER if thresholds else 1)


def whole(effort: Effort) -> tuple[Stage, ...]:
    """Start from nothing: search under a soft horizon that hardens, then as `again`."""
    tolerance = effort.tolerance
    search = tuple(
        Descend(n_step, tolerance, softness, noise)
        for softness, noise, n_step in (
            (0.3, 0.5, MOST),
            (0.1, None, MOST),
            (0.03, None, MOST),
            (0.01, None, MOST),
        )
    )
    return search + after_light(effort)


def after_light(effort: Effort) -> tuple[Stage, ...]:
    """Go on after the light has changed."""
    tolerance = effort.tolerance
    settle = Descend(MOST, tolerance), Starts(4, 3, tolerance)
    return settle + (ThresholdSpread(4, 3, tolerance),) + refine(effort)


def after_model(effort: Effort) -> tuple[Stage, ...]:
    """Go on after the forward model has changed."""
    return (Descend(4, effort.tolerance, softness=0.01),) + after_light(effort)


def after_events(effort: Effort) -> tuple[Stage, ...]:
    """Go on after the events have changed a little."""
    return (Descend(MOST, effort.tolerance), ThresholdSpread(4, 3, effort.tolerance)) + refine(effort)


def refine(effort: Effort) -> tuple[Stage, ...]:
    """Use all that the events say, then let neighbours speak."""
    tolerance = effort.tolerance
    descend = Descend(MOST, tolerance, fine=True, name="refinement")
    return (HearAll(), descend, Respread(MOST, tolerance), SoftHorizon(MOST, tolerance)) + know(effort)


def quick(effort: Effort) -> tuple[Stage, ...]:
    """Go on as well as is needed to see where light goes: without silence, event times and neighbours."""
    tolerance = effort.tolerance
    steps = Descend(4, tolerance), Starts(1, 2, tolerance), ThresholdSpread(1, 2, tolerance)
    last = HearAll(), Descend(4, tolerance, name="refinement")
    return (*steps, *last, PixelNoise(fine=False, each=False), Neighbours(None, fine=False))


def know(effort: Effort) -> tuple[Stage, ...]:
    """Say how well the pixels are known, and let neighbours speak."""
    return PixelNoise(), Neighbours(effort.priors)


def neighbours(effort: Effort) -> tuple[Stage, ...]:
    """Let neighbours speak of pixels that are solved alone."""
    descend = Descend(0, effort.tolerance, fine=True, name="refinement")
    return (HearAll(), descend, SoftHorizon(3, effort.tolerance)) + know(effort)


def measure() -> tuple[Stage, ...]:
    """Stay where one is; say how well that is known."""
    return PixelNoise(), Neighbours(None)


def trial(tolerance: float = 0.1) -> tuple[Stage, ...]:
    """Solve pixels that have no neighbours and no silences, to compare costs."""
    search = (
        Descend(n_step, tolerance, softness, noise)
        for softness, noise, n_step in ((0.3, 0.5, 6), (0.1, None, 3), (0.02, None, 3), (None, None, 8))
    )
    last = Descend(8, tolerance, fine=True, name="refinement"), Respread(8, tolerance)
    return (*search, ThresholdSpread(2, 2, tolerance), HearAll(), *last, PixelNoise(), Neighbours(None))


def alone(effort: Effort) -> Effort:
    """Leave each pixel alone."""
    return replace(effort, priors=None)
