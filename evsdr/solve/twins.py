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

SAME = 0.25  # scatter of the log reflectance of one metal; guessed
N_LEVEL = 200  # of reflectance that are tried


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
        system = system_of(data, state, self.terms.loss(data))
        starts = state.theta, _twin(data.model, state.theta)
        found = [descend(system, theta, self.n_step, self.tolerance)[:2] for theta in starts]
        n_band = data.model.illumination.n_band
        cost = np.stack([terms[0].numpy() for _, terms in found]).astype(float)
        level = np.stack([np.mean([t.numpy() for t in theta[2 : 2 + n_band]], axis=0) for theta, _ in found])
        other = owned(type(state.theta[0]), second_of(cost, level, data.pairs.counts > len(state.theta))) > 0
        theta, terms = ([dr.select(other, b, a) for a, b in zip(*both)] for both in zip(*found))
        dr.eval(theta, terms)
        return replace(state, theta=theta, terms=terms, n_step=state.n_step + 2 * self.n_step)


@recorded
def _twin(model, theta: list) -> list:
    return model.twin(theta)


def second_of(cost: np.ndarray, level: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Choose the second of two explanations of some pixels, told (n_pixel) bool.

    What these have in common is the level that makes the best choices likeliest.

    Parameters
    ----------
    cost, level : (2, n_pixel) float
        Of either explanation: its cost, and its log reflectance.
    told : (n_pixel,) bool

    Returns
    -------
    (n_pixel,) bool
    """
    if not told.any():
        return told
    levels = np.linspace(*np.quantile(level[:, told], (0, 1)), N_LEVEL)

    def total(common):
        return cost + np.log1p(np.square((level - common) / SAME))

    common = levels[np.argmin([total(c)[:, told].min(axis=0).sum() for c in levels])]
    return told & (np.argmin(total(common), axis=0) == 1)
