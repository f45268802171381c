"""What a solve is given, what its stages hand on, and what comes of it."""

from dataclasses import dataclass, field, replace

import numpy as np

from evsdr.solve.grid import Grid
from evsdr.solve.pair_data import PairData
from evsdr.solve.unknowns import Unknowns

SETTLED, STEPS_USED_UP, NO_INFORMATION = "settled", "steps used up", "no information"
OF_PIXEL = (
    "theta",
    "covariance",
    "cost",
    "noise_factor",
    "threshold_gain",
    "threshold_gain_sigma",
    "model_error",
)


@dataclass(frozen=True)
class Data:
    """What is given, and stays as it is while stages run.

    Attributes
    ----------
    model : callable (p, q, reflectance, softness) -> (signal, by_p, by_q[, diffuse])
        Forward model, such as `LambertianRing` or `GlossyRing`: a PyTree of Dr.Jit arrays with the bands of the LEDs
        in `illumination.band`; gives lists over LEDs. `diffuse` is the part of the signal that scales with the
        reflectance, all by default.
    pairs : PairData
        Event pairs.
    constant_light : Float
        C_w, above 0.
    grid : Grid
        Neighbours of each pixel.
    robust : float
        Width of the Cauchy cost in standard deviations.
    room : Float
        See `pair_data.room_for`.
    """

    model: object
    pairs: PairData
    constant_light: object
    grid: Grid
    robust: float
    room: object

    def unknowns(self, theta: list) -> Unknowns:
        """Tell what the unknowns mean."""
        n_band = self.model.illumination.n_band
        return Unknowns(n_band, len(theta) > 2 + n_band)


@dataclass(frozen=True)
class State:
    """What stages hand on; each gives a new one.

    Attributes
    ----------
    theta : list of Float, (n_unknown)
        See `unknowns`.
    spread : list of Float
        How the logarithms of the thresholds' factors are distributed over the pixels: two centres, two standard
        deviations, of width 1; empty where thresholds are known.
    terms : list of Float, optional
        Cost, gradient and lower triangle of the Gauss-Newton matrix at theta.
    pairs : PairData, optional
        The pairs that count so far.
    noise : float
        Standard deviation of the relative residual in most pixels.
    noise_factor : (n_pixel,) float32, optional
        How much larger it is in each pixel.
    per_slot : (n_pixel,) float, optional
        Events of a slot and polarity in which a pixel has any.
    softness : Float
        Of the horizon, of width 1 or n_pixel.
    curved : bool
        Whether it follows the surface's curvature.
    covariance : (n_pixel, n_unknown, n_unknown) float64, optional
    prior_scale : dict
        Scales of the priors that counted.
    n_step : int
        Steps made so far.
    open : float
        Share of the pixels whose cost still fell in the last step.
    """

    theta: list
    spread: list = field(default_factory=list)
    terms: list | None = None
    pairs: PairData | None = None
    noise: float = 0.5
    noise_factor: np.ndarray | None = None
    per_slot: np.ndarray | None = None
    softness: object = None
    curved: bool = False
    covariance: np.ndarray | None = None
    prior_scale: dict = field(default_factory=dict)
    n_step: int = 0
    open: float = 0.0


@dataclass(frozen=True)
class Passed:
    """A stage that has run.

    Attributes
    ----------
    stage : str
        Its name.
    steps : int
    mean_cost : float, optional
        Of all pixels, after it; None where the pairs have just changed.
    open : float
        Share of the pixels whose cost still fell by more than the tolerance in its last step.
    seconds : float
    """

    stage: str
    steps: int
    mean_cost: float | None
    open: float
    seconds: float


@dataclass(frozen=True)
class Solution:
    """What the solver found.

    Attributes
    ----------
    theta : (n_pixel, 2 + n_band) float32
        Slopes and log reflectances.
    covariance : (n_pixel, 2 + n_band, 2 + n_band) float64
        Of these.
    cost : (n_pixel,) float32
        Robust cost of the single pixel, weak prior included.
    noise : float
        Standard deviation of the relative residual in most pixels, measured.
    noise_factor : (n_pixel,) float32
        How much larger it is in each pixel; `noise.IGNORED` where the model explains little.
    n_step : int
        Steps made.
    result : str
        `settled`, `steps used up`, or `no information`.
    history : tuple of Passed
        The stages that ran.
    threshold_gain, threshold_gain_sigma : (n_pixel, 2) float32, optional
        Estimated factors on the told C_on and C_off, and one standard deviation of each, relative.
    threshold_prior : tuple of 4 float, optional
        How the logarithms of the factors are distributed over the pixels: two centres, two standard deviations.
    prior_scale : dict
        Scales of the priors that counted, see `neighbours.posterior.Posterior`.
    curved : bool
        Whether the horizon was as soft as the surface is curved within a pixel.
    model_error : (n_pixel, 2 + n_band, 2 + n_band) float32, optional
        Covariance beside that of events and priors, see `fitting.model_error`.
    """

    theta: np.ndarray
    covariance: np.ndarray
    cost: np.ndarray
    noise: float
    noise_factor: np.ndarray
    n_step: int
    result: str = SETTLED
    history: tuple[Passed, ...] = ()
    threshold_gain: np.ndarray | None = None
    threshold_gain_sigma: np.ndarray | None = None
    threshold_prior: tuple | None = None
    prior_scale: dict = field(default_factory=dict)
    curved: bool = False
    model_error: np.ndarray | None = None

    def at(self, row: np.ndarray) -> "Solution":
        """Keep some pixels (n,) int."""
        of_pixel = {name: getattr(self, name) for name in OF_PIXEL}
        return replace(self, **{name: value[row] for name, value in of_pixel.items() if value is not None})

    @property
    def all_theta(self) -> np.ndarray:
        """All unknowns (n_pixel, n_unknown), those of thresholds too."""
        if self.threshold_gain is None:
            return self.theta
        return np.column_stack([self.theta, np.log(self.threshold_gain)])

    def moved(self, by: np.ndarray) -> "Solution":
        """Move log reflectances, and logarithms of thresholds where they are unknown, of all pixels alike, by (n_unknown,)."""
        n = self.theta.shape[1]
        theta = self.theta + np.append(np.zeros(2), by[2:n]).astype(np.float32)
        if self.threshold_gain is None:
            return replace(self, theta=theta)
        gain = self.threshold_gain * np.exp(by[n:]).astype(np.float32)
        prior = (*(np.array(self.threshold_prior[:2]) + by[n:]), *self.threshold_prior[2:])
        return replace(self, theta=theta, threshold_gain=gain, threshold_prior=prior)

    def with_thresholds(self, mean: np.ndarray) -> "Solution":
        """Move thresholds alike, until the means (2,) of their logarithms are as told."""
        by = np.zeros(self.theta.shape[1] + 2)
        by[-2:] = mean - np.array(self.threshold_prior[:2])
        return self.moved(by)
