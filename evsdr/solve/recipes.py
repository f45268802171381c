"""Recipes: which stages a solve goes through, by what it is for and how hard it shall try."""

from dataclasses import dataclass, replace

from evsdr.solve.coarse import Coarse
from evsdr.solve.learning import Neighbours, PixelNoise, Respread, ThresholdSpread
from evsdr.solve.neighbours.posterior import Priors
from evsdr.solve.stages import (
    ALL_TERMS,
    PAIRS,
    AllPairs,
    Descend,
    SoftHorizon,
    Stage,
    Starts,
    Terms,
)
from evsdr.solve.tuning import Tuning
from evsdr.solve.twins import Twins

MOST = 30  # steps of a descent: those that have not settled then never will
OF_METAL = 0.4, 0.25, 0.15, 0.1, 0.05  # softness, see `model.metal`
FIRST_NOISE = 0.5  # of the relative residual, before anything is known


@dataclass(frozen=True)
class Effort:
    """How hard to try.

    Attributes
    ----------
    tolerance : float
        Gain in log likelihood of a pixel that is worth a step.
    n_early : int
        Events of a pixel that count until the last stages.
    n_most : int, optional
        Events of a pixel that count at all.
    robust : float
        Width of the Cauchy cost in standard deviations, where thresholds are known.
    priors : Priors, optional
        What pixels tell of each other; None leaves each alone.
    tuning : Tuning
    """

    tolerance: float = 0.1
    n_early: int = 64
    n_most: int | None = None
    robust: float = 2.0
    priors: Priors | None = Priors()
    tuning: Tuning = Tuning()

    def at(self, tolerance: float) -> "Effort":
        """Try as hard as a tolerance asks."""
        priors = self.priors and replace(self.priors, tolerance=tolerance)
        return replace(self, tolerance=tolerance, priors=priors)

    def width(self, thresholds: bool) -> float:
        """Give the width of the Cauchy cost, with thresholds unknown or not."""
        return self.robust * (self.tuning.wider if thresholds else 1)


def whole(effort: Effort) -> tuple[Stage, ...]:
    """Start from nothing: search under a soft horizon, then refine."""
    return (*searched(effort), *refine(effort))


def rough(effort: Effort) -> tuple[Stage, ...]:
    """Start from nothing; go as far as is needed to see what is told wrong and what all pixels share: each alone."""
    effort = replace(effort, priors=None)
    return (*searched(effort), *hear_all(effort), *know(effort))


def searched(effort: Effort) -> tuple[Stage, ...]:
    """Search from nothing, on every few pixels where there are many; then all follow."""
    search = Descend(MOST, effort.tolerance, effort.tuning.softness, FIRST_NOISE)
    follow = Descend(MOST, effort.tolerance), Starts(min(effort.tuning.n_sweep, 1), 3, effort.tolerance)
    return (Coarse((search, *descend_and_start(effort)), follow),)


def rough_metal(effort: Effort) -> tuple[Stage, ...]:
    """As `rough`, from rough metal to metal as it is: narrow lobes leave most starts without a slope."""
    effort = replace(effort, priors=None)
    search = (Descend(MOST, effort.tolerance, softness, FIRST_NOISE) for softness in OF_METAL)
    return (*search, *descend_and_start(effort), *hear_all(effort), *know(effort))


def sketch_after_light(effort: Effort) -> tuple[Stage, ...]:
    """Go on after the light has changed, on early events only."""
    return *descend_and_start(effort), *soft_horizon(effort, 3), *know(effort)


def after_light(effort: Effort) -> tuple[Stage, ...]:
    """Go on after the light has changed."""
    return (*descend_and_start(effort), *refine(effort))


def descend_and_start(effort: Effort) -> tuple[Stage, ...]:
    """Descend on early events, also from neighbours' solutions; find how thresholds are distributed."""
    starts = Starts(effort.tuning.n_sweep, 3, effort.tolerance)
    return Descend(MOST, effort.tolerance), starts, spread(effort)


def after_model(effort: Effort) -> tuple[Stage, ...]:
    """Go on after the forward model has changed."""
    return (Descend(4, effort.tolerance, softness=0.01), *after_light(effort))


def after_events(effort: Effort) -> tuple[Stage, ...]:
    """Go on after the events have changed a little."""
    return (Descend(MOST, effort.tolerance), spread(effort), *refine(effort))


def sketch(effort: Effort) -> tuple[Stage, ...]:
    """Go on after the events have changed a little, on early ones only."""
    return Descend(MOST, effort.tolerance), spread(effort), *soft_horizon(effort, 3), *know(effort)


def spread(effort: Effort) -> Stage:
    """Find how unknown thresholds are distributed."""
    return ThresholdSpread(effort.tuning.n_spread, 3, effort.tolerance, last_terms(effort))


def refine(effort: Effort) -> tuple[Stage, ...]:
    """Use all that the events say, then let neighbours speak."""
    return (*hear_all(effort), respread(effort), *know(effort))


def hear_all(effort: Effort) -> tuple[Stage, ...]:
    """Descend on all events, also where the horizon follows the surface."""
    descend = Descend(MOST, effort.tolerance, terms=last_terms(effort), name="refinement")
    twins = Twins(MOST, effort.tolerance, last_terms(effort))
    return (AllPairs(), descend, *soft_horizon(effort, MOST), twins)


def respread(effort: Effort) -> Stage:
    """Find noise and thresholds' distribution anew, now that all events count."""
    return Respread(MOST, effort.tolerance, last_terms(effort))


def soft_horizon(effort: Effort, n_step: int) -> tuple[Stage, ...]:
    """Let the horizon follow the surface, if that is asked for."""
    return (SoftHorizon(n_step, effort.tolerance, last_terms(effort)),) if effort.tuning.curved else ()


def quick(effort: Effort) -> tuple[Stage, ...]:
    """Go on as well as is needed to see where light goes: without silence, event times and neighbours."""
    tolerance = effort.tolerance
    steps = Descend(4, tolerance), Starts(1, 2, tolerance), ThresholdSpread(1, 2, tolerance)
    last = AllPairs(), Descend(4, tolerance, name="refinement")
    return (*steps, *last, PixelNoise(PAIRS, None), Neighbours(None, PAIRS))


def search(effort: Effort) -> tuple[Stage, ...]:
    """Start from nothing; go as far as is needed to see what light photoreceptors lag in."""
    return (*searched(effort), PixelNoise(PAIRS, None), Neighbours(None, PAIRS))


def touch(effort: Effort) -> tuple[Stage, ...]:
    """Follow events that have changed a little, as well as is needed to see what light photoreceptors lag in."""
    return Descend(MOST, effort.tolerance), PixelNoise(PAIRS, None), Neighbours(None, PAIRS)


def know(effort: Effort) -> tuple[Stage, ...]:
    """Say how well the pixels are known, and let neighbours speak."""
    terms = last_terms(effort)
    return PixelNoise(terms, effort.tuning.misfit), Neighbours(effort.priors, terms, effort.tuning.curved)


def last_terms(effort: Effort) -> Terms:
    """Give what counts in the last stages beside event pairs."""
    return Terms(effort.tuning.density, effort.tuning.silence)


def measure() -> tuple[Stage, ...]:
    """Stay where one is; say how well that is known."""
    return PixelNoise(), Neighbours(None)


def trial(tolerance: float = 0.1) -> tuple[Stage, ...]:
    """Solve pixels that have no neighbours and no silences, to compare costs."""
    search = (
        Descend(n_step, tolerance, softness, noise)
        for softness, noise, n_step in (
            (0.3, FIRST_NOISE, 6),
            (0.1, None, 3),
            (0.02, None, 3),
            (None, None, 8),
        )
    )
    last = Descend(8, tolerance, terms=ALL_TERMS, name="refinement"), Respread(8, tolerance)
    return (*search, ThresholdSpread(2, 2, tolerance), AllPairs(), *last, PixelNoise(), Neighbours(None))
