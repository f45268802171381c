"""What all pixels share, inferred together with the maps of some pixels.

The normal matrix has a block for each pixel and a border for what they share. Schur's complement onto the border gives
a Gauss-Newton step of what is shared, and with it one of each pixel; both are damped (Marquardt 1963). Scatter of the
events and spread of the thresholds are learnt between rounds of steps.
"""

from dataclasses import dataclass, replace

import numpy as np

from evsdr.events.lead import TABLE
from evsdr.events.photoreceptor import SHORTEST
from evsdr.solve.law import gaussian_share
from evsdr.solve.noise import NOISE_RANGE
from evsdr.solve.shared.kernel import ON, Terms, pixel_sums
from evsdr.solve.shared.pixels import Pixels
from evsdr.solve.shared.rig import GROUPS, NAMES, NOT_NEGATIVE, TIMES, Basis, Rig, Told
from evsdr.solve.threshold_spread import MEDIAN_OF_SQUARE, SMALLEST_SPREAD
from evsdr.solve.unknowns import (
    LARGEST_SLOPE,
    LARGEST_STEP,
    LOG_REFLECTANCE_RANGE,
    LOG_REFLECTANCE_SIGMA,
    REFLECTANCE_CENTRE,
    SLOPE_SIGMA,
    to_normal,
)

N_ROUND, N_STEP = 4, 4  # of steps with one scatter; guessed: the last ones hardly move anything
SLACK = 0.5  # log likelihood that a pixel may lose in a step
RISEN = 0.01  # mean loss of that from which a step is refused
SETTLED_DEG = 0.01  # by which a step turns normals when it is the last
FIRST_DAMPING, DAMPING_RANGE = 1e-3, (1e-6, 1e6)
FIRST_STIFFNESS, MOST_STIFFNESS = 1e-2, 1e3
ROBUST = 3.0  # width of Cauchy's cost in standard deviations, as for maps where thresholds are unknown
STEPS = (1e-5, 1e-4, 1e-5, 1e-6, 1e-6)  # of timing, for derivatives


@dataclass(frozen=True)
class Start:
    """Where the inference starts.

    Attributes
    ----------
    theta : (n_pixel, n) float
        Slopes, log reflectances, and where thresholds are unknown the logarithms of their factors.
    rig : Rig
    spread : (2,) float
        Standard deviation of these logarithms over the pixels.
    scatter : float
        Standard deviation of the relative residual.
    """

    theta: np.ndarray
    rig: Rig
    spread: np.ndarray
    scatter: float


@dataclass(frozen=True)
class Inferred:
    """What was inferred.

    Attributes
    ----------
    rig, sigma : Rig
        Values, and their standard deviations.
    theta, spread, scatter
        See `Start`.
    turn_deg : dict of str to float
        By which mean angle the normals of these pixels turn because of each of `rig.GROUPS`.
    wanted : dict of str to float
        Of timing that was left at 0: how many standard deviations above that the events want it.
    n_step : int
    """

    rig: Rig
    sigma: Rig
    theta: np.ndarray
    spread: np.ndarray
    scatter: float
    turn_deg: dict
    wanted: dict
    n_step: int


@dataclass(frozen=True)
class Point:
    """The posterior at some values.

    Attributes
    ----------
    theta : (n_pixel, n)
    free : (n_free,)
        What is shared, along the basis.
    cost, gradient, matrix
        Of each pixel, see `kernel.pixel_sums`, priors included.
    residual, variance : (n_event,)
    """

    theta: np.ndarray
    free: np.ndarray
    cost: np.ndarray
    gradient: np.ndarray
    matrix: np.ndarray
    residual: np.ndarray
    variance: np.ndarray


@dataclass(frozen=True)
class Posterior:
    """Of the maps of some pixels and what they share.

    Attributes
    ----------
    pixels : Pixels
    basis : Basis
    sigma : (n_free,) float
        Of the prior, along the basis.
    told, centre : (3 n_led + 7,) and (n_free,) float
        What is told, across the basis and along it.
    own_thresholds, tilted : bool
        Whether thresholds of each pixel, and directions of LEDs, are unknown.
    scatter, spread
        See `Start`.
    weigh : (n_event,) float
        See `kernel.pixel_sums`.
    """

    pixels: Pixels
    basis: Basis
    sigma: np.ndarray
    told: np.ndarray
    centre: np.ndarray
    own_thresholds: bool
    tilted: bool
    scatter: float
    spread: np.ndarray
    weigh: np.ndarray

    @property
    def n_map(self) -> int:
        return 2 + self.pixels.light.n_band

    def rig(self, free: np.ndarray) -> Rig:
        """Give all values."""
        return Rig.of(self.told + self.basis.vectors @ free, self.pixels.light.n_led)

    @property
    def vectors(self) -> np.ndarray:
        """The basis, in the border's columns."""
        return self.basis.vectors if self.tilted else self.basis.vectors[: self.pixels.light.n_led + 7]

    def at(self, theta: np.ndarray, free: np.ndarray) -> Point:
        """Evaluate it."""
        pixels, rig, n_map = self.pixels, self.rig(free), self.n_map
        light = pixels.light
        gains = theta[:, n_map:] if self.own_thresholds else rig.log_threshold
        values = np.tile([max(rig.tau, SHORTEST), rig.dark, rig.noise, rig.shift, rig.refractory], (6, 1))
        values[1:] += np.diag(STEPS)
        maps = theta[:, :n_map]
        sums = pixel_sums(
            pixels.events,
            pixels.leds,
            np.array(light.band),
            float(light.constant_light[0]),
            pixels.signals(maps, rig),
            pixels.tilts(maps, rig) if self.tilted else np.zeros((len(theta), light.n_led, 0)),
            pixels.threshold * np.exp(gains),
            self.own_thresholds,
            values,
            Terms(pixels.crossfade, self.scatter, ROBUST, gaussian_share(ROBUST)),
            TABLE,
            self.weigh,
        )
        return self._with_priors(Point(theta, free, *sums), rig)

    def _with_priors(self, point: Point, rig: Rig) -> Point:
        """Add the weak priors of the maps, and the distribution of thresholds over the pixels."""
        n_map, n = self.n_map, point.theta.shape[1]
        cost, gradient, matrix = point.cost, point.gradient, point.matrix
        sigma = np.repeat((SLOPE_SIGMA, LOG_REFLECTANCE_SIGMA), (2, n_map - 2))
        centre = np.repeat((0.0, np.log(REFLECTANCE_CENTRE)), (2, n_map - 2))
        off = (point.theta[:, :n_map] - centre) / sigma
        cost += 0.5 * np.sum(off**2, axis=1)
        gradient[:, :n_map] += off / sigma
        some = np.arange(n_map)
        matrix[:, some, some] += sigma**-2
        if self.own_thresholds:
            off = (point.theta[:, n_map:] - rig.log_threshold) / self.spread
            cost += 0.5 * np.sum(off**2, axis=1)
            gradient[:, n_map:n] += off / self.spread
            for k, precision in enumerate(self.spread**-2):
                both = np.array([n_map + k, n + self.pixels.light.n_led + ON + k])
                gradient[:, both[1]] -= off[:, k] / self.spread[k]
                matrix[:, both[:, None], both] += precision * np.array([[1, -1], [-1, 1]])
        return point

    def solve(self, point: Point, damping=0.0, stiffness: float = 0.0) -> tuple:
        """Eliminate the maps.

        Returns
        -------
        step : (n_free,)
        response : (n_pixel, n, n_free)
            Of the maps to what is shared.
        rest : (n_pixel, n)
            Step of the maps if nothing else moved.
        complement : (n_free, n_free)
            Schur's.
        """
        n, vectors = point.theta.shape[1], self.vectors
        own, cross = point.matrix[:, :n, :n].copy(), point.matrix[:, :n, n:] @ vectors
        np.einsum("nii->ni", own)[:] *= 1 + np.reshape(damping, (-1, 1))
        right = np.concatenate([cross, point.gradient[:, :n, None]], axis=2)
        solved = np.linalg.solve(own, right)
        response, rest = -solved[:, :, :-1], -solved[:, :, -1]
        complement = vectors.T @ point.matrix[:, n:, n:].sum(axis=0) @ vectors + np.diag(self.sigma**-2)
        complement += np.einsum("nij,nik->jk", cross, response, optimize=True)
        slope = point.gradient[:, n:].sum(axis=0) @ vectors + (point.free - self.centre) / self.sigma**2
        slope += np.einsum("nij,ni->j", cross, rest)
        stiff = complement + stiffness * np.diag(np.diag(complement))
        return -np.linalg.solve(stiff, slope), response, rest, complement

    def wanted(self, point: Point, told: Told, name: str) -> float:
        """Give how many standard deviations above 0 the events want what was not free (Rao 1948, score test)."""
        more = Basis.of((*self.basis.owner.tolist(), name), self.pixels.light.band)
        sigma = np.array([told.tolerance(self.pixels.slot_us)[owner] for owner in more.owner])
        step, _, _, complement = replace(
            self, basis=more, sigma=sigma, centre=more.vectors.T @ self.basis.vectors @ self.centre
        ).solve(replace(point, free=more.vectors.T @ self.basis.vectors @ point.free))
        k = list(more.owner).index(name)
        return float(step[k] / np.sqrt(np.linalg.inv(complement)[k, k]))

    def moved(self, point: Point, step: np.ndarray, response: np.ndarray, rest: np.ndarray) -> Point:
        """Evaluate it after a step, kept to sensible lengths and values."""
        longest = np.repeat(LARGEST_STEP, (2, point.theta.shape[1] - 2))
        theta = point.theta + np.clip(rest + response @ step, -longest, longest)
        theta[:, :2] = np.clip(theta[:, :2], -LARGEST_SLOPE, LARGEST_SLOPE)
        theta[:, 2:] = np.clip(theta[:, 2:], *LOG_REFLECTANCE_RANGE)
        free = point.free + step
        free = np.where(np.isin(self.basis.owner, NOT_NEGATIVE), np.maximum(free, 0), free)
        free = np.where(self.basis.owner == "refractory", np.minimum(free, self.pixels.shortest), free)
        return self.at(theta, free)

    def learnt(self, point: Point) -> "Posterior":
        """Learn scatter and spread from what remains."""
        counts = np.isfinite(point.residual)
        square = np.median(point.residual[counts] ** 2) / MEDIAN_OF_SQUARE - np.median(point.variance[counts])
        scatter, spread = np.sqrt(max(square, NOISE_RANGE[0] ** 2)), self.spread
        if self.own_thresholds:
            n = point.theta.shape[1]
            left = np.einsum("nii->ni", np.linalg.inv(point.matrix[:, :n, :n]))[:, self.n_map :]
            off = point.theta[:, self.n_map :] - self.rig(point.free).log_threshold
            spread = np.sqrt(np.maximum(np.mean(off**2 + left, axis=0), SMALLEST_SPREAD**2))
        return replace(self, scatter=float(scatter), spread=spread, weigh=point.variance)


def infer(
    pixels: Pixels,
    start: Start,
    told: Rig,
    tolerance: Told = Told(),
    names: tuple[str, ...] = NAMES,
) -> Inferred:
    """Infer what pixels share, together with their maps.

    Parameters
    ----------
    told : Rig
        What is told of them; no tau and no noise are 0.
    tolerance : Told
        How well.
    names : tuple of str
        Of `NAMES`: what is unknown. The rest stays as told.
    """
    posterior = _posterior(pixels, start, told, tolerance, names)
    point = posterior.at(start.theta, posterior.basis.vectors.T @ start.rig.vector)
    posterior = replace(posterior, weigh=point.variance)
    damped, n_step = Damping(np.full(len(start.theta), FIRST_DAMPING)), 0
    for round_ in range(N_ROUND):
        point, damped, moved, made = _descend(posterior, posterior.at(point.theta, point.free), damped)
        posterior, n_step = posterior.learnt(point), n_step + made
        if moved < SETTLED_DEG and round_:
            break
    _, response, _, complement = posterior.solve(point)
    away, owner = point.free - posterior.centre, posterior.basis.owner
    turn = {
        group: turn_deg(point.theta, response @ np.where(np.isin(owner, of_group), away, 0))
        for group, of_group in GROUPS.items()
    }
    covariance = posterior.basis.vectors @ np.linalg.inv(complement) @ posterior.basis.vectors.T
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0))
    left = [name for name in TIMES if name not in names and getattr(told, name) == 0]
    return Inferred(
        posterior.rig(point.free),
        Rig.of(sigma, pixels.light.n_led),
        point.theta,
        posterior.spread,
        posterior.scatter,
        turn,
        {name: posterior.wanted(point, tolerance, name) for name in left},
        n_step,
    )


def _posterior(pixels: Pixels, start: Start, told: Rig, tolerance: Told, names: tuple[str, ...]) -> Posterior:
    """Set the posterior up."""
    basis, vector = Basis.of(names, pixels.light.band), told.vector
    width = tolerance.tolerance(pixels.slot_us)
    centre = basis.vectors.T @ vector
    return Posterior(
        pixels,
        basis,
        sigma=np.array([width[name] for name in basis.owner]),
        told=vector - basis.vectors @ centre,
        centre=centre,
        own_thresholds=start.theta.shape[1] > 2 + pixels.light.n_band,
        tilted="directions" in names,
        scatter=start.scatter,
        spread=np.asarray(start.spread, float),
        weigh=np.zeros(pixels.n_event),
    )


@dataclass(frozen=True)
class Damping:
    """Of the pixels' steps (n_pixel,), and of what they share."""

    pixel: np.ndarray
    shared: float = 0.0

    def after(self, worse: np.ndarray, refused: bool) -> "Damping":
        """Damp pixels that lost by a step more, and what they share if it was refused."""
        pixel = np.clip(np.where(worse, 8 * self.pixel, 0.25 * self.pixel), *DAMPING_RANGE)
        stiffer = min(max(10 * self.shared, FIRST_STIFFNESS), MOST_STIFFNESS)
        return Damping(pixel, stiffer if refused else 0.5 * self.shared)


def _descend(posterior: Posterior, point: Point, damping: Damping) -> tuple[Point, Damping, float, int]:
    """Make steps until they turn no normals; gives the last point, damping, its turn [deg], and the steps."""
    moved = np.inf
    for made in range(1, N_STEP + 1):
        step, response, rest, _ = posterior.solve(point, damping.pixel, damping.shared)
        new = posterior.moved(point, step, response, rest)
        change = new.cost - point.cost
        worse, refused = change > SLACK, np.clip(change, -SLACK, SLACK).mean() > RISEN
        damping = damping.after(worse, refused)
        if refused:
            continue
        moved = turn_deg(point.theta, response @ (new.free - point.free))
        point = _mixed(point, new, worse)
        if moved < SETTLED_DEG:
            break
    return point, damping, moved, made


def _mixed(old: Point, new: Point, worse: np.ndarray) -> Point:
    """Take a step where pixels don't lose by it; what is shared moves anyway."""

    def choose(name):
        a, b = getattr(old, name), getattr(new, name)
        return np.where(worse.reshape(-1, *[1] * (a.ndim - 1)), a, b)

    return replace(new, **{name: choose(name) for name in ("theta", "cost", "gradient", "matrix")})


def turn_deg(theta: np.ndarray, move: np.ndarray) -> float:
    """Give the mean angle [deg] by which a move turns normals."""
    before, after = to_normal(theta), to_normal(theta + move)
    return float(np.degrees(np.linalg.norm(after - before, axis=1)).mean()) if len(theta) else 0.0
