"""Numbers of the solver's statistics and search that `experiments/ablation` varies."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Tuning:
    """What the recipes are made of. Each number is guessed unless it says otherwise.

    Attributes
    ----------
    softness : float, optional
        Width of the smooth horizon under which the search begins; None begins under the hard one. Measured: more of
        them on the way to the hard one change nothing.
    n_sweep : int
        Sweeps over the neighbours' solutions at most; 0 leaves them out.
    n_spread : int
        Rounds of expectation maximisation at most that look for the distribution of unknown thresholds.
    wider : float
        Width of the Cauchy cost of the first stages where thresholds are unknown, relative to that where they are known:
        the tails of the residuals tell of them.
    density, silence : bool
        Whether the density of event times, and silence, count in the last stages.
    curved : bool
        Whether surfaces may be curved within a pixel, so that the horizon is soft and the light not quite the model's.
    misfit : float
        Noise of a pixel, relative to most, from which its events contradict the model and count for nothing.
    """

    softness: float | None = 0.3
    n_sweep: int = 4
    n_spread: int = 4
    wider: float = 1.5
    density: bool = True
    silence: bool = True
    curved: bool = True
    misfit: float = 3.0
