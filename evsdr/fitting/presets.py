"""The presets: points between speed and accuracy."""

from dataclasses import dataclass

from evsdr.solve import levenberg
from evsdr.solve.effort import Effort


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
    "fast": Preset(levenberg.PRESETS["fast"], rays=4, thorough=False),
    "balanced": Preset(levenberg.PRESETS["balanced"], rays=16),
    "accurate": Preset(levenberg.PRESETS["accurate"], rays=64),
}
