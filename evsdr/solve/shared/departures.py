"""What each pixel sees of each LED otherwise than its model says: small shadows, several surfaces in one pixel, light by other ways.

Such departures are no noise, but the same at each event under an LED; left out, they pass for LEDs of other powers, late
events, and a lag of another length. Each is an unknown of its own, log A_xj + d_xj, normally distributed about 0; how widely, the
events tell. They are eliminated pixel by pixel, so that what is left has the form it had without.
"""

from dataclasses import dataclass, fields

import numpy as np

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
    follow : (n_pixel, n_led, n + m) float64
        How the best ones fall with the n maps of a pixel and the m shared unknowns.
    rest : (n_pixel, n_led) float64
        How far they fall if nothing else moves.
    left : (n_pixel, n_led) float64
        Their variance if all else is known.
    """

    value: np.ndarray
    follow: np.ndarray
    rest: np.ndarray
    left: np.ndarray

    def after(self, theta: np.ndarray, shared: np.ndarray) -> np.ndarray:
        """Give them after maps moved by (n_pixel, n), and what is shared by (m,)."""
        n = theta.shape[1]
        fallen = (
            self.rest + np.einsum("xjn,xn->xj", self.follow[:, :, :n], theta) + self.follow[:, :, n:] @ shared
        )
        return np.clip(self.value - fallen, -LARGEST, LARGEST)

    def followed(self, slope: np.ndarray, n: int) -> np.ndarray:
        """Give slopes (n_pixel, n_kind, n + m) of kinds of events where departures follow all else."""
        led = slice(n, n + self.value.shape[1])
        return slope - slope[:, :, led] @ self.follow

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
        follow = self.follow[heard][:, :, :n]
        of_maps = np.linalg.inv(matrix[heard][:, :n, :n])
        left = self.left[heard] + np.einsum("xja,xab,xjb->xj", follow, of_maps, follow, optimize=True)
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
    across, identity = matrix[:, led], np.broadcast_to(np.eye(n_led), own.shape)
    half = np.linalg.solve(root, np.concatenate([across, pull[:, :, None], identity], axis=2))
    whole = np.linalg.solve(np.swapaxes(root, 1, 2), half[:, :, : across.shape[2] + 1])
    of_all, of_pull, of_own = np.split(half, [across.shape[2], across.shape[2] + 1], axis=2)
    cost = cost + 0.5 * np.sum(value**2, axis=1) / sigma**2 - 0.5 * np.sum(of_pull**2, axis=(1, 2))
    gradient = gradient - (np.swapaxes(of_all, 1, 2) @ of_pull)[:, :, 0]
    departures = Departures(value, whole[:, :, :-1], whole[:, :, -1], np.sum(of_own**2, axis=1))
    return cost, gradient, matrix - np.swapaxes(of_all, 1, 2) @ of_all, departures
