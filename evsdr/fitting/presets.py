"""The presets: points between speed and accuracy."""

from dataclasses import dataclass

from evsdr.solve.neighbours.posterior import Priors
from evsdr.solve.recipes import Effort


@dataclass(frozen=True)
class Preset:
    """All that a preset settles.

    Attributes
    ----------
    effort : Effort
        How hard the solver tries, rounds of the priors included.
    rays : int
        Most rays per pixel, for visibility.
    thorough : bool
        Whether effects are looked for that show only in the residuals of a fit.
    """

    effort: Effort
    rays: int
    thorough: bool = True


PRESETS = {
    "fast": Preset(
        Effort(n_early=40, n_most=48, priors=Priors(n_round=3, n_draw=2)).at(1.0), rays=16, thorough=False
    ),
    "balanced": Preset(Effort().at(0.1), rays=64),
    "accurate": Preset(Effort(priors=Priors(n_draw=16)).at(0.03), rays=256),
}
