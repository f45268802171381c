"""How hard the solver tries: the presets of the command."""

from dataclasses import dataclass

from evsdr.solve.neighbours.posterior import Priors


@dataclass(frozen=True)
class Effort:
    """How hard to try; the presets of the command.

    Attributes
    ----------
    stages : tuple of (softness, noise or None, n_step)
        Descent from the start: width of the smooth horizon, standard deviation of the relative residual
        (None: as measured), and steps.
    n_sweep : int
        Sweeps with the hard horizon, in which each pixel tries the solutions of its four neighbours.
    n_try : int
        Steps granted to such a start before it is compared.
    n_final : int
        Steps at the end.
    n_pair : int
        Events of a pixel that count before the last steps.
    n_most : int, optional
        Events of a pixel that count at all.
    n_expectation : int
        Rounds of expectation maximisation that look for the distribution of unknown thresholds.
    robust : float
        Width of the Cauchy cost in standard deviations; half as much again where thresholds are unknown.
    fine : bool
        Whether the last steps also use the density of event times, silence, each pixel's own noise, and, where the
        events agree, a horizon as soft as the surface within a pixel is curved.
    silence : bool
        Whether that no event fired counts in them.
    priors : Priors, optional
        What pixels tell of each other; None leaves each alone.
    """

    stages: tuple = ((0.3, 0.5, 8), (0.1, None, 5), (0.03, None, 4), (0.01, None, 4))
    n_sweep: int = 1
    n_try: int = 3
    n_final: int = 6
    n_pair: int = 64
    n_most: int | None = None
    n_expectation: int = 4
    robust: float = 2.0
    fine: bool = True
    silence: bool = True
    priors: Priors | None = Priors()


PRESETS = {
    "fast": Effort(
        stages=((0.3, 0.5, 6), (0.1, None, 3), (0.02, None, 3)),
        n_sweep=1,
        n_try=2,
        n_final=4,
        n_pair=40,
        n_most=48,
        n_expectation=2,
        priors=Priors(n_round=3, n_draw=2),
    ),
    "balanced": Effort(),
    "accurate": Effort(
        n_sweep=4, n_try=5, n_final=15, n_pair=128, n_expectation=6, priors=Priors(n_round=12, n_draw=16)
    ),
}
