"""What each pixel sees of each LED otherwise than its model says: small shadows, several surfaces in one pixel, light by other ways.

Such departures are no noise, but the same at each event under an LED; left out, they pass for LEDs of other powers, late
events, and a lag of another length. Each is an unknown of its own, log A_xj + d_xj, normally distributed about 0; how widely, the
events tell. They are eliminated pixel by pixel, so that what is left has the form it had without.
"""

from dataclasses import dataclass, fields

import numpy as np
from numba import njit

FIRST = 0.02  # standard deviation to start from; guessed
# Of what is learnt of it; guessed. Measured: with 0.3 and 0.08 at most a white lion (`experiments.draws`, 41) comes out at 11.1 and 10.4
# degrees, a glossy goathead (45) at 4.6 and 4.8
LEAST, MOST = 1e-3, 0.1
LARGEST = 1.0  # of a departure
ROUNDING = 1e-10  # of what is known best, what is known of each at least: float64 could not invert it


@dataclass(frozen=True)
class Departures:
    """Departures of some pixels.

    Attributes
    ----------
    value : (n_pixel, n_led) float64
        Where costs stand.
    root : (n_pixel, n_led, n_led) float64
        Cholesky's lower root L of the information on them if all else is known.
    across : (n_pixel, n_led, n + m) float64
        L x = this: how the best ones fall, L' x, with the n maps of a pixel and the m shared unknowns.
    pull : (n_pixel, n_led, 1) float64
        The same if nothing else moves.
    """

    value: np.ndarray
    root: np.ndarray
    across: np.ndarray
    pull: np.ndarray

    def after(self, theta: np.ndarray, shared: np.ndarray) -> np.ndarray:
        """Give them after maps moved by (n_pixel, n), and what is shared by (m,)."""
        n = theta.shape[1]
        fallen = self.pull + self.across[:, :, :n] @ theta[:, :, None]
        fallen[:, :, 0] += self.across[:, :, n:] @ shared
        _backward(self.root, fallen)
        return np.clip(self.value - fallen[:, :, 0], -LARGEST, LARGEST)

    def followed(self, slope: np.ndarray, n: int) -> np.ndarray:
        """Give slopes (n_pixel, n_kind, n + m) of kinds of events where departures follow all else."""
        of_led = np.ascontiguousarray(np.swapaxes(slope[:, :, n : n + self.value.shape[1]], 1, 2))
        _forward(self.root, of_led)
        return slope - np.swapaxes(of_led, 1, 2) @ self.across

    def put(self, some: np.ndarray, other: "Departures") -> "Departures":
        """Put others in the place of some pixels (n,) int."""
        values = {field.name: getattr(self, field.name).copy() for field in fields(self)}
        for name, value in values.items():
            value[some] = getattr(other, name)
        return Departures(**values)

    def learnt(self, matrix: np.ndarray, n: int, heard: np.ndarray, before: float) -> float:
        """Learn their standard deviation by its evidence (MacKay 1992, Neural Comput. 4(3), eq. 4.12), from pixels that are heard.

        `matrix` (n_pixel, n + m, n + m) is that of `eliminated`, `n` the number of maps.
        """
        root, follow = self.root[heard], self.across[heard][:, :, :n].copy()
        _backward(root, follow)
        if_known = np.tile(np.eye(root.shape[1]), (len(root), 1, 1))
        _forward(root, if_known)
        of_maps = np.linalg.inv(matrix[heard][:, :n, :n])
        left = np.sum(if_known**2, axis=1) + np.sum((follow @ of_maps) * follow, axis=2)
        told = np.sum(1 - left / before**2)
        variance = (np.sum(self.value[heard] ** 2) + FIRST**2) / (max(told, 0) + 1)
        return float(np.clip(np.sqrt(variance), LEAST, MOST))


def eliminated(value, sigma, n, cost, gradient, matrix) -> tuple:
    """Eliminate departures from sums over the events of pixels.

    Parameters
    ----------
    value : (n_pixel, n_led) float
    sigma : float
        Standard deviation of their distribution.
    n : int
        Number of the unknowns of a pixel; those of the LEDs' log powers follow.
    cost, gradient, matrix
        Of the sums, priors of all else included.

    Returns
    -------
    cost, gradient, matrix
        Where departures are best for all else.
    departures : Departures
    """
    n_led = value.shape[1]
    led = slice(n, n + n_led)
    own = matrix[:, led, led] + np.eye(n_led) / sigma**2
    largest = np.einsum("xii->xi", own).max(axis=1)
    own += ROUNDING * largest[:, None, None] * np.eye(n_led)
    pull = gradient[:, led] + value / sigma**2
    # By Cholesky's root: where one event outweighs all others, products with the inverse leave matrices that are none of a minimum
    root = np.linalg.cholesky(own)
    both = np.concatenate([matrix[:, led], pull[:, :, None]], axis=2)
    _forward(root, both)
    across, pull = both[:, :, :-1], both[:, :, -1:]
    cost = cost + 0.5 * np.sum(value**2, axis=1) / sigma**2 - 0.5 * np.sum(pull**2, axis=(1, 2))
    transposed = np.swapaxes(across, 1, 2)
    gradient = gradient - (transposed @ pull)[:, :, 0]
    return cost, gradient, matrix - transposed @ across, Departures(value, root, across, pull)


@njit(cache=True, error_model="numpy")
def _forward(root, right):
    """Solve L x = b for lower triangular L (n_pixel, n, n) and b (n_pixel, n, k), in the place of b.

    SciPy before 1.16, the last for Python 3.10, solves one at a time. Measured by hand: 300 of 24 x 24 with 47 columns take .9 ms, by SciPy 1.17 5.6.
    """
    for x in range(len(root)):
        for i in range(root.shape[1]):
            for j in range(i):
                _add(right, x, i, j, -root[x, i, j])
            _scale(right, x, i, 1 / root[x, i, i])


@njit(cache=True, error_model="numpy")
def _backward(root, right):
    """Solve L' x = b likewise."""
    for x in range(len(root)):
        for i in range(root.shape[1] - 1, -1, -1):
            for j in range(i + 1, root.shape[1]):
                _add(right, x, i, j, -root[x, j, i])
            _scale(right, x, i, 1 / root[x, i, i])


@njit(cache=True, inline="always")
def _scale(right, x, i, factor):
    """Multiply row i."""
    for k in range(right.shape[2]):
        right[x, i, k] *= factor


@njit(cache=True, inline="always")
def _add(right, x, i, j, factor):
    """Add row j to row i, times a factor."""
    for k in range(right.shape[2]):
        right[x, i, k] += factor * right[x, j, k]
