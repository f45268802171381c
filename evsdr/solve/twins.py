"""Normals that metal shows nearly alike: which of two, its reflectance tells, as one metal has the same everywhere."""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.frozen import recorded
from evsdr.model.arrays import owned
from evsdr.progress import silent
from evsdr.solve.levenberg import descend
from evsdr.solve.solution import Data, State
from evsdr.solve.stages import ALL_TERMS, Terms
from evsdr.solve.system import system_of
from evsdr.solve.unknowns import apart

SAME, LEAST_SAME = (
    0.25,
    0.03,
)  # scatter of the log reflectance of one metal: to start from, and at least; guessed
N_LEVEL = 200  # of reflectance that are tried
RARE = 0.03  # chance of a twin that three sigma need not hold
MOST_GAIN = 3.0  # in log likelihood that events of a pixel have in the choice, as `effects.sample.MOST_GAIN`


@dataclass(frozen=True)
class Twins:
    """Give each pixel of metal the normal with which its reflectance is that of the others.

    Attributes
    ----------
    n_step, tolerance
        See `Descend`.
    terms : Terms
    """

    n_step: int
    tolerance: float
    terms: Terms = ALL_TERMS
    name: str = "twins"

    def __call__(self, data: Data, state: State, progress=silent) -> State:
        if not hasattr(data.model, "twin"):
            return state
        both = self.explain(data, state)
        second = second_of(both.cost, both.level, both.told)
        other = owned(type(state.theta[0]), second) > 0
        theta = [dr.select(other, b, a) for a, b in zip(*both.theta)]
        terms = [dr.select(other, b, a) for a, b in zip(*both.terms)]
        dr.eval(theta, terms)
        return replace(state, theta=theta, terms=terms, n_step=state.n_step + 2 * self.n_step)

    def explain(self, data: Data, state: State) -> "Both":
        """Descend from where pixels are, and from their twins."""
        system = system_of(data, state, self.terms.loss(data))
        starts = state.theta, _twin(data.model, state.theta)
        found = [descend(system, theta, self.n_step, self.tolerance)[:2] for theta in starts]
        theta, terms = zip(*found)
        n_map = 2 + data.model.illumination.n_band
        maps = np.array([[t.numpy() for t in one[:n_map]] for one in theta], float).transpose(0, 2, 1)
        cost = np.array([one[0].numpy() for one in terms], float)
        return Both(theta, terms, maps, cost, data.pairs.counts > len(state.theta))


@dataclass(frozen=True)
class Both:
    """Two explanations of each pixel.

    Attributes
    ----------
    theta, terms : 2 lists of Float
        See `State`.
    maps : (2, n_pixel, 2 + n_band) float
        Slopes and log reflectances.
    cost : (2, n_pixel) float
    told : (n_pixel,) bool
        Whether events are enough to tell.
    """

    theta: tuple
    terms: tuple
    maps: np.ndarray
    cost: np.ndarray
    told: np.ndarray

    @property
    def level(self) -> np.ndarray:
        """Log reflectances (2, n_pixel)."""
        return self.maps[:, :, 2:].mean(axis=-1)

    def left_open(self, noise_factor: np.ndarray) -> np.ndarray:
        """Give the covariances (n_pixel, n, n) of not knowing which it is, where the first has been chosen."""
        cost = self.cost / np.square(np.maximum(noise_factor, 1))
        against = cost + unlike_most(cost, self.level, self.told)
        share = self.told / (1 + np.exp(np.clip(against[1] - against[0], -50, 50)))
        share = np.where(share > RARE, share, 0)
        return share[:, None, None] * apart(*self.maps)


@recorded
def _twin(model, theta: list) -> list:
    return model.twin(theta)


def second_of(cost: np.ndarray, level: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Choose the second of two explanations of some pixels, told (n_pixel) bool.

    What these have in common is the level that makes the best choices likeliest. Pixels in which a model of one normal is wrong
    prefer either for no good reason, so that no events count for more than `MOST_GAIN`.

    Parameters
    ----------
    cost, level : (2, n_pixel) float
        Of either explanation: its cost, and its log reflectance.
    told : (n_pixel,) bool

    Returns
    -------
    (n_pixel,) bool
    """
    cost = np.minimum(cost - cost.min(axis=0), MOST_GAIN)
    against = cost + unlike_most(cost, level, told)
    return told & (against[1] < against[0])


def unlike_most(cost: np.ndarray, level: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Give the costs (2, n_pixel) of levels that are not that of most, whose scatter is learnt; arguments as of `second_of`."""
    if not told.any():
        return np.zeros(cost.shape)
    levels, scatter = np.linspace(*np.quantile(level[:, told], (0, 1)), N_LEVEL), SAME
    for _ in range(2):
        away = np.log1p(np.square((level - levels[:, None, None]) / scatter)) + np.log(scatter)
        best = np.argmin(np.min(cost + away, axis=1)[:, told].sum(axis=1))
        nearer = np.argmin(cost + away[best], axis=0)
        off = np.abs(level - levels[best])[nearer, np.arange(len(told))]
        scatter = max(float(np.median(off[told])), LEAST_SAME)
    return np.log1p(np.square((level - levels[best]) / scatter))
