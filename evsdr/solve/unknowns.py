"""What the unknowns of a pixel mean: the only place that knows what theta[i] is.

theta = two slopes (p, q) of the surface, n ~ (-p, -q, 1); the logarithm of each band's reflectance; and, where
thresholds are unknown, the logarithms of the factors on C_on and C_off.
"""

from dataclasses import dataclass

import drjit as dr
import numpy as np

from evsdr.model.arrays import columns, owned
from evsdr.solve.grid import nearest

SLOPE_SIGMA = 5.0  # weak prior: a slope of 5 is a surface seen at 79 degrees
REFLECTANCE_CENTRE = 0.25
# Weak prior of log reflectances, of what all bands have in common and of each: 0.03 .. 2 within one sigma
LOG_COMMON_SIGMA, LOG_COLOUR_SIGMA = 1.3, 1.5
# Pixels that share one weak prior where they are tied to each other, by their neighbours or by what all share: each on its own
# would count it as often. Measured on white spheres: 20 to all alike, 1 pulls them down; on a plane at 80 degrees, of which what
# pixels share is inferred: with 1 it is found at 45 degrees, by LED powers that are 48 % off
TIED = 100
LARGEST_STEP = (1.0, 2.0)  # of a slope, of a logarithm
KNOWN_SIGMA_DEG = 30.0  # a normal known worse than this is not known
# Of the logarithm of what all bands have in common: a scale known worse than this is not known. Data then give nine tenths
# of what is said of it (derived: its weak prior has 1.3)
KNOWN_SCALE = 0.4
LARGEST_SLOPE, LOG_REFLECTANCE_RANGE = 30.0, (-9.0, 1.5)
SLOPES = slice(0, 2)


@dataclass(frozen=True)
class Unknowns:
    """The unknowns of a pixel.

    Attributes
    ----------
    n_band : int
        Number of bands.
    thresholds : bool
        Whether the factors on both thresholds are among them.
    """

    n_band: int
    thresholds: bool

    @property
    def n_map(self) -> int:
        """Number of those that become maps."""
        return 2 + self.n_band

    @property
    def number(self) -> int:
        return self.n_map + 2 * self.thresholds

    def reflectance(self, theta: list) -> list:
        """Give the reflectance of each band."""
        return [dr.exp(t) for t in theta[2 : self.n_map]]

    def gains(self, theta: list) -> list | None:
        """Give the factors on C_on and C_off; None where thresholds are known."""
        return [dr.exp(t) for t in theta[self.n_map :]] if self.thresholds else None

    def prior(self, theta: list, spread: list, weak) -> tuple:
        """Give what is known before any event: cost, gradient, and lower triangle of the matrix.

        Parameters
        ----------
        theta : list of Float
            Unknowns.
        spread : list of Float
            Two centres and two standard deviations of the logarithms of the thresholds' factors; empty if those are known.
        weak : Float
            How much the priors of slopes and reflectances count.
        """
        first, (middle, precision) = self.n_map, weak_prior(self.n_band)
        off = [t - c for t, c in zip(theta, middle.tolist())]
        entries = {(i, j): weak * p for (i, j), p in np.ndenumerate(precision) if p and j <= i}
        pull = [0.0] * first
        for (i, j), p in entries.items():
            pull[i] += p * off[j]
            if i != j:
                pull[j] += p * off[i]
        cost = 0.5 * sum(a * b for a, b in zip(pull, off))
        for i, (t, centre, sigma) in enumerate(zip(theta[first:], spread[:2], spread[2:]), first):
            entries[i, i] = dr.rcp(sigma * sigma)
            pull.append((t - centre) * entries[i, i])
            cost += 0.5 * (t - centre) * pull[i]
        return cost, pull, [entries.get((i, j), 0.0) for i in range(self.number) for j in range(i + 1)]

    @staticmethod
    def moved(theta: list, move: list) -> list:
        """Add a step, kept to a sensible length, and stay within sensible values."""
        out = []
        for i, (t, m) in enumerate(zip(theta, move)):
            longest = LARGEST_STEP[i >= 2]
            low, high = (-LARGEST_SLOPE, LARGEST_SLOPE) if i < 2 else LOG_REFLECTANCE_RANGE
            out.append(dr.clip(t + dr.clip(m, -longest, longest), low, high))
        return out


def weak_prior(n_band: int) -> tuple[np.ndarray, np.ndarray]:
    """Give centre (2 + n_band) and precision (2 + n_band, 2 + n_band) of what is known of slopes and log reflectances."""
    centre = np.repeat((0.0, np.log(REFLECTANCE_CENTRE)), (2, n_band))
    covariance = np.diag(np.repeat((SLOPE_SIGMA**2, LOG_COLOUR_SIGMA**2), (2, n_band)))
    covariance[2:, 2:] += LOG_COMMON_SIGMA**2
    return centre, np.linalg.inv(covariance)


def to_theta(normal: np.ndarray, reflectance: np.ndarray, Float: type) -> list:
    """Give slopes and log reflectances of normals (n, 3) and reflectances (n, n_band) as Dr.Jit arrays of a type."""
    nz = np.maximum(normal[:, 2:], 1 / LARGEST_SLOPE)
    log_reflectance = np.log(np.maximum(reflectance, np.exp(LOG_REFLECTANCE_RANGE[0])))
    return columns(Float, np.column_stack([-normal[:, :2] / nz, log_reflectance]))


def first_theta(normal: np.ndarray, n_band: int, thresholds: bool, Float: type) -> list:
    """Give unknowns to start from: normals (n, 3), reflectances of which nothing is known, thresholds as told."""
    theta = to_theta(normal, np.full((len(normal), n_band), REFLECTANCE_CENTRE), Float)
    return theta + columns(Float, np.zeros((len(normal), 2 * thresholds)))


def to_normal(theta: np.ndarray) -> np.ndarray:
    """Give unit normals (n, 3) of unknowns (n, n_unknown)."""
    normal = np.column_stack([-theta[:, SLOPES], np.ones(len(theta))])
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def normal_sigma_deg(p: np.ndarray, q: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Turn the covariance (n, 2, 2) of slopes into the standard deviation of the normal's angle [deg].

    The root of the trace of the normal's covariance: the root mean square angle.
    """
    h2 = 1 + p**2 + q**2
    # |dn|^2 of a change of slopes is the metric of the sphere in these coordinates
    metric = np.stack([[1 + q**2, -p * q], [-p * q, 1 + p**2]]) / h2**2
    variance = np.einsum("ijn,nij->n", metric, covariance)
    return np.degrees(np.sqrt(np.maximum(variance, 0)))


def log_spread(variance: np.ndarray) -> np.ndarray:
    """Give how far quantities are from e^m, relative to it and root mean square, whose logarithms are normal about m.

    Derived: the mean square of e^x - 1 is e^(2 v) - 2 e^(v / 2) + 1 for x of the variance v. Of small ones that is v; at a standard deviation of
    0.5 it is 0.62, as what is as likely above e^m as below is farther off there.
    """
    v = np.clip(variance, 0, 100)  # far beyond any use, and no overflow
    return np.sqrt(np.maximum(np.expm1(2 * v) - 2 * np.expm1(v / 2), 0))


def apart(maps: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Give the covariances (n, m, m) of other maps (n, m) about some, with changes of slopes that make the whole angle."""
    change, p, q = (other - maps).astype(float), *maps[:, :2].T.astype(float)
    cosine = np.sum(to_normal(maps) * to_normal(other), axis=1)
    told = normal_sigma_deg(p, q, change[:, :2, None] * change[:, None, :2])
    change[:, :2] *= (np.degrees(np.arccos(np.clip(cosine, -1, 1))) / np.maximum(told, 1e-6))[:, None]
    return change[:, :, None] * change[:, None, :]


def fill(theta: list, good: np.ndarray, mask: np.ndarray) -> list:
    """Give each pixel that is not good (n_pixel) the unknowns of the nearest one that is."""
    if good.all() or not good.any():
        return theta
    index = owned(dr.uint32_array_t(type(theta[0])), nearest(good, mask))
    return [dr.gather(type(t), t, index) for t in theta]
