"""The posterior of the maps of some pixels and of what they share, with a Gauss-Newton step of both.

The normal matrix has a block for each pixel and a border for what they share; Schur's complement onto the border gives
the step of what is shared, and with it one of each pixel.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from evsdr.solve.law import MEDIAN_OF_SQUARE, gaussian_share, variance_of
from evsdr.solve.noise import NOISE_RANGE
from evsdr.solve.shared.departures import FIRST, Departures, eliminated
from evsdr.solve.shared.kernel import ON, Terms
from evsdr.solve.shared.pixels import Pixels
from evsdr.solve.shared.rig import N_TIMING, NOT_NEGATIVE, Basis, Rig, Told
from evsdr.solve.threshold_spread import LARGEST_VARIANCE, SMALLEST_SPREAD
from evsdr.solve.unknowns import (
    LARGEST_SLOPE,
    LARGEST_STEP,
    LOG_REFLECTANCE_RANGE,
    TIED,
    weak_prior,
)

LEARNT = "powers", "directions"  # many of a kind: how well they are told shows in how far they are off
# Tolerances that what is learnt of that may be, at most; guessed. On planes, where powers and the normal are one unknown too many, the
# farther off powers are the less is held of what is told of them
MOST_LEARNT = 3.0
AGREES = 3.5  # standard deviations of a pixel's misfit from that of most, within which it is heard
ROBUST = 3.0  # width of Cauchy's cost in standard deviations, as for maps where thresholds are unknown
SLACK = 0.5  # log likelihood that a pixel may lose in a step
# Of what a pixel loses or gains by a step, how much counts when it is judged: one that falls into another minimum may do so by any
# amount. Guessed; measured on few events under LEDs that switch (`experiments.draws`, 12): with 0.5 a search from the truth ends 3200 above it
MOST_COUNTED = 10.0
# Of the scatter before, that a round leaves at least: what is far off for a smaller one pulls no more. Measured (`experiments.draws`, 1018, of which
# the model holds all to .005 of a threshold): a surface's distance ends .018 or .048 off, as rounding has it, normals 76 93 98 or 20 56 86 % within
# 1 2 3 sigma; with this .008 or .021, 77 93 98 or 33 75 90 %. By another mask .7 did as well as this in more steps
LEAST_LEFT = 0.5
SLOPE_TERM = gaussian_share(ROBUST)


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
    departs : float
        That of departures, see `departures`.
    """

    theta: np.ndarray
    rig: Rig
    spread: np.ndarray
    scatter: float
    departs: float = FIRST


@dataclass(frozen=True)
class Point:
    """The posterior at some values.

    Attributes
    ----------
    theta : (n_pixel, n)
    free : (n_free,)
        What is shared, along the basis.
    cost, gradient, matrix
        Of each pixel, see `kernel.pixel_sums`, priors included, departures eliminated.
    residual, variance : (n_event,)
    departures : Departures
        Of what each pixel sees of the LEDs from its model.
    """

    theta: np.ndarray
    free: np.ndarray
    cost: np.ndarray
    gradient: np.ndarray
    matrix: np.ndarray
    residual: np.ndarray
    variance: np.ndarray
    departures: Departures


@dataclass(frozen=True)
class Posterior:
    """Of the maps of some pixels and what they share.

    Attributes
    ----------
    pixels : Pixels
    basis : Basis
    sigma, told_sigma : (n_free,) float
        Of the prior, along the basis: as it is now, and as told.
    told, centre : (3 n_led + N_TIMING,) and (n_free,) float
        What is told, across the basis and along it.
    own_thresholds, tilted : bool
        Whether thresholds of each pixel, and directions of LEDs, are unknown.
    stirred : tuple of str
        Of `pixels.STEPS`: those by which derivatives are wanted.
    scatter, spread
        See `Start`.
    weigh : (n_event,) float
        See `kernel.pixel_sums`.
    heard : (n_pixel,) bool
        Pixels that tell what is shared; the others, whose events don't agree with it, only follow.
    departs : float
        Standard deviation of departures.
    """

    pixels: Pixels
    basis: Basis
    sigma: np.ndarray
    told_sigma: np.ndarray
    told: np.ndarray
    centre: np.ndarray
    own_thresholds: bool
    tilted: bool
    stirred: tuple[str, ...]
    scatter: float
    spread: np.ndarray
    weigh: np.ndarray
    heard: np.ndarray
    departs: float

    @property
    def n_map(self) -> int:
        return 2 + self.pixels.light.n_band

    def rig(self, free: np.ndarray) -> Rig:
        """Give all values."""
        return Rig.of(self.told + self.basis.vectors @ free, self.pixels.light.n_led)

    @property
    def vectors(self) -> np.ndarray:
        """The basis, in the border's columns."""
        return self.basis.vectors if self.tilted else self.basis.vectors[: self.pixels.light.n_led + N_TIMING]

    def at(
        self,
        theta: np.ndarray,
        free: np.ndarray,
        some: np.ndarray | None = None,
        departure: np.ndarray | None = None,
    ) -> Point:
        """Evaluate it, or only the rows of some pixels, (n,) int; departures (n_pixel, n_led) are 0 by default."""
        departure = np.zeros((len(theta), self.pixels.light.n_led)) if departure is None else departure
        *of_pixels, residual, variance = self._sums(theta, free, departure, some)
        if some is not None:
            theta, departure, *of_pixels = (values[some] for values in (theta, departure, *of_pixels))
        return self._point(theta, free, departure, *of_pixels, residual, variance)

    def again(self, point: Point) -> Point:
        """Evaluate it once more, after something was learnt."""
        return self.at(point.theta, point.free, departure=point.departures.value)

    def by_kind(self, point: Point, kind: np.ndarray) -> tuple[Point, np.ndarray]:
        """Evaluate it again, and give the slopes of each kind of event, too.

        Parameters
        ----------
        kind : (n_event,) int64

        Returns
        -------
        point : Point
        slope : (n_pixel, n_kind, n + m)
            Of the cost, without priors, see `kernel.pixel_sums`; departures follow.
        """
        departure = point.departures.value
        cost, slope, *rest = self._sums(point.theta, point.free, departure, kind=kind)
        new = self._point(point.theta, point.free, departure, cost, slope.sum(axis=1), *rest)
        return new, new.departures.followed(slope, point.theta.shape[1])

    def _sums(self, theta, free, departure, some=None, kind=None) -> tuple:
        """See `kernel.pixel_sums`."""
        terms = Terms(self.pixels.crossfade, self.scatter, ROBUST, SLOPE_TERM, self.pixels.clock)
        given = self.own_thresholds, self.tilted, terms, self.weigh, some, self.stirred
        return self.pixels.sums(theta, self.rig(free), *given, kind, departure)

    def _point(self, theta, free, departure, cost, gradient, matrix, residual, variance) -> Point:
        """Add priors, and eliminate departures."""
        sums = self._with_priors(theta, self.rig(free), cost, gradient, matrix)
        *sums, departures = eliminated(departure, self.departs, theta.shape[1], *sums)
        return Point(theta, free, *sums, residual, variance, departures)

    def _with_priors(self, theta, rig: Rig, cost, gradient, matrix) -> tuple:
        """Add the weak priors of the maps, and the distribution of thresholds over the pixels."""
        n_map, n = self.n_map, theta.shape[1]
        centre, precision = weak_prior(n_map - 2)
        precision = precision / min(len(self.heard), TIED)
        off = theta[:, :n_map] - centre
        cost += 0.5 * np.einsum("ni,ij,nj->n", off, precision, off)
        gradient[:, :n_map] += off @ precision
        matrix[:, :n_map, :n_map] += precision
        if self.own_thresholds:
            off = (theta[:, n_map:] - rig.log_threshold) / self.spread
            cost += 0.5 * np.sum(off**2, axis=1)
            gradient[:, n_map:n] += off / self.spread
            for k, precision in enumerate(self.spread**-2):
                both = np.array([n_map + k, n + self.pixels.light.n_led + ON + k])
                gradient[:, both[1]] -= off[:, k] / self.spread[k]
                matrix[:, both[:, None], both] += precision * np.array([[1, -1], [-1, 1]])
        return cost, gradient, matrix

    def solve(self, point: Point, damping=0.0, stiffness: float = 0.0) -> tuple:
        """Eliminate the maps.

        Damping (n_pixel,) is that of the pixels' own steps. How they follow what is shared is not damped: pixels that can't
        move, as in a wrong minimum, would hold it. Measured: of a sphere before near LEDs, .7 nearer than told, searches from .6
        farther, as told, and .6 nearer ended at -.51, 0 and .52; now at .52, .53, .54.

        Returns
        -------
        step : (n_free,)
        response : (n_pixel, n, n_free)
            Of the maps to what is shared.
        rest : (n_pixel, n)
            Step of the maps if nothing else moved, damped.
        complement : (n_free, n_free)
            Schur's.
        """
        n, vectors = point.theta.shape[1], self.vectors
        own, cross = point.matrix[:, :n, :n], point.matrix[:, :n, n:] @ vectors
        right = np.concatenate([cross, point.gradient[:, :n, None]], axis=2)
        solved = np.linalg.solve(own, right)
        response, rest = -solved[:, :, :-1], -solved[:, :, -1]
        heard = self.heard
        complement = vectors.T @ point.matrix[heard, n:, n:].sum(axis=0) @ vectors + np.diag(self.sigma**-2)
        complement += _stacked(cross[heard]).T @ _stacked(response[heard])
        slope = point.gradient[heard, n:].sum(axis=0) @ vectors + (point.free - self.centre) / self.sigma**2
        slope += _stacked(cross[heard]).T @ rest[heard].ravel()
        if np.any(damping):
            damped = own.copy()
            np.einsum("nii->ni", damped)[:] *= 1 + np.reshape(damping, (-1, 1))
            rest = -np.linalg.solve(damped, right[:, :, -1:])[:, :, 0]
        return -np.linalg.solve(stiffened(complement, stiffness), slope), response, rest, complement

    def within(
        self, free: np.ndarray, step: np.ndarray, complement: np.ndarray, stiffness: float = 0.0
    ) -> np.ndarray:
        """End a step where values have their bounds, and let the others go with them: the best of all such steps."""
        if (self.bounded(free + step) == free + step).all():
            return step
        curvature = stiffened(complement, stiffness)
        least, most = (self.bounded(np.full(len(free), end)) - free for end in (-np.inf, np.inf))
        unit = np.sqrt(np.diag(curvature))
        length, along = np.linalg.eigh(curvature / np.outer(unit, unit))
        root = np.sqrt(np.maximum(length, 0))[:, None] * along.T  # rounding may leave less than nothing
        return lsq_linear(root, root @ (unit * step), (unit * least, unit * most), method="bvls").x / unit

    def bounded(self, free: np.ndarray) -> np.ndarray:
        """Keep what is shared to what can be."""
        return bounded(free, self.basis, self.pixels)

    def lacks_lag(self, point: Point) -> bool:
        """Tell whether photoreceptors are as quick as can be."""
        return bool((point.free[self.basis.owner == "tau"] <= self.pixels.quickest).any())

    def wanted(self, point: Point, told: Told, name: str) -> float:
        """Give how many standard deviations above 0 the events want what was not free (Rao 1948, score test)."""
        step, complement, k = self._if_free(point, told, name)
        return float(step[k] / np.sqrt(np.linalg.inv(complement)[k, k]))

    def considered(self, point: Point, told: Told, name: str) -> np.ndarray:
        """Give the covariance (n_free, n_free) that comes of not knowing better than told what is not free."""
        _, complement, k = self._if_free(point, told, name)
        others = np.arange(len(complement)) != k
        response = np.linalg.solve(complement[others][:, others], complement[others, k])
        return np.outer(response, response) * told.tolerance(self.pixels.slot_us)[name] ** 2

    def _if_free(self, point: Point, told: Told, name: str) -> tuple[np.ndarray, np.ndarray, int]:
        """Solve as if something were free, too; gives step, Schur's complement, and its place in these."""
        more = Basis.of((*self.basis.owner.tolist(), name), self.pixels.light.band)
        sigma = np.array([told.tolerance(self.pixels.slot_us)[owner] for owner in more.owner])
        step, _, _, complement = replace(
            self, basis=more, sigma=sigma, centre=more.vectors.T @ self.basis.vectors @ self.centre
        ).solve(replace(point, free=more.vectors.T @ self.basis.vectors @ point.free))
        return step, complement, list(more.owner).index(name)

    def moved(self, point: Point, step: np.ndarray, response: np.ndarray, rest: np.ndarray) -> Point:
        """Evaluate it after a step, kept to sensible lengths and values."""
        longest = np.repeat(LARGEST_STEP, (2, point.theta.shape[1] - 2))
        theta = point.theta + np.clip(rest + response @ step, -longest, longest)
        theta[:, :2] = np.clip(theta[:, :2], -LARGEST_SLOPE, LARGEST_SLOPE)
        theta[:, 2:] = np.clip(theta[:, 2:], *LOG_REFLECTANCE_RANGE)
        free = self.bounded(point.free + step)
        departure = point.departures.after(theta - point.theta, self.vectors @ (free - point.free))
        return self.at(theta, free, departure=departure)

    def kept(self, old: Point, new: Point, worse: np.ndarray) -> Point:
        """Leave the maps of some pixels, (n_pixel,) bool, as they were; what is shared moves anyway."""
        some = np.flatnonzero(worse)
        both = (old.theta, new.theta), (old.departures.value, new.departures.value)
        theta, departure = (np.where(worse[:, None], *of) for of in both)
        stayed = self.at(theta, new.free, some, departure)
        of_event = np.repeat(worse, np.diff(self.pixels.events[0]))

        def put(name):
            values = getattr(new, name).copy()
            values[some] = getattr(stayed, name)
            return values

        of_pixels = {name: put(name) for name in ("theta", "cost", "gradient", "matrix")}
        of_events = {
            name: np.where(of_event, getattr(stayed, name), getattr(new, name))
            for name in ("residual", "variance")
        }
        departures = new.departures.put(some, stayed.departures)
        return replace(new, **of_pixels, **of_events, departures=departures)

    def risen(self, old: Point, new: Point) -> float:
        """Give the mean cost that pixels lost, each counted up to `MOST_COUNTED`."""
        before, after = (np.sum(((at.free - self.centre) / self.sigma) ** 2) for at in (old, new))
        change = np.clip(new.cost - old.cost, -MOST_COUNTED, MOST_COUNTED)[self.heard]
        return float((change.sum() + 0.5 * (after - before)) / max(len(change), 1))

    def learnt(self, point: Point) -> "Posterior":
        """Learn scatter and spread from what remains, which pixels are heard, and how well LEDs are told."""
        counts = np.isfinite(point.residual)
        told = point.residual[counts], ROBUST, point.variance[counts]
        scatter, spread = np.sqrt(variance_of(*told, NOISE_RANGE[0] ** 2)), self.spread
        if self.own_thresholds:
            n = point.theta.shape[1]
            left = np.einsum("nii->ni", np.linalg.inv(point.matrix[:, :n, :n]))[:, self.n_map :]
            off = point.theta[:, self.n_map :] - self.rig(point.free).log_threshold
            most = np.median(off**2, axis=0) / MEDIAN_OF_SQUARE  # some sit in a wrong minimum
            square = most + np.median(left, axis=0)
            spread = np.sqrt(np.clip(square, SMALLEST_SPREAD**2, LARGEST_VARIANCE))
        scatter = max(scatter, LEAST_LEFT * self.scatter)
        heard = agreeing(point.residual, point.variance, self.pixels.events[0], scatter)
        departs = point.departures.learnt(point.matrix, point.theta.shape[1], heard, self.departs)
        learnt = {"scatter": float(scatter), "spread": spread, "heard": heard, "departs": departs}
        new = replace(self, weigh=point.variance, **learnt)
        return replace(new, sigma=new.learnt_sigma(point))

    def learnt_sigma(self, point: Point) -> np.ndarray:
        """Learn how well powers and directions are told, by their evidence (MacKay 1992, Neural Comput. 4(3), eq. 4.12).

        What is told of that counts as much as one more LED whose events tell it.
        """
        sigma, left = self.sigma.copy(), np.diag(np.linalg.inv(self.solve(point)[3]))
        for name in LEARNT:
            of = self.basis.owner == name
            if of.any():
                known = np.sum(1 - left[of] / self.sigma[of] ** 2)
                square = np.sum((point.free - self.centre)[of] ** 2) + self.told_sigma[of][0] ** 2
                sigma[of] = np.minimum(np.sqrt(square / (known + 1)), MOST_LEARNT * self.told_sigma[of])
        return sigma


def bounded(free: np.ndarray, basis: Basis, pixels: Pixels) -> np.ndarray:
    """Keep what is shared to what can be: no negative times, no lag that is none, no refractory period longer than any gap."""
    owner = basis.owner
    least = np.where(np.isin(owner, NOT_NEGATIVE), 0, -np.inf)
    least = np.where(owner == "tau", pixels.quickest, least)
    most = np.where(owner == "refractory", pixels.shortest, np.inf)
    if pixels.nearer:
        reach = np.where(owner == "distance", pixels.nearer.reach, np.inf)
        least, most = np.maximum(least, -reach), np.minimum(most, reach)
    return np.clip(free, least, most)


def stiffened(complement: np.ndarray, stiffness: float) -> np.ndarray:
    """Damp the step of what is shared (Marquardt 1963)."""
    return complement + stiffness * np.diag(np.diag(complement))


def agreeing(residual: np.ndarray, variance: np.ndarray, offset: np.ndarray, scatter: float) -> np.ndarray:
    """Tell which pixels' events agree with the model about as well as those of most; others sit in a wrong minimum.

    Events of pixel i are offset[i] .. offset[i + 1]; residual and variance are those of `kernel.pixel_sums`.
    """
    misfit = np.log1p(residual**2 / (scatter**2 + variance) / ROBUST**2)
    counts = np.isfinite(misfit)
    summed = np.append(0.0, np.cumsum(np.where(counts, misfit - misfit[counts].mean(), 0.0)))
    number = np.append(0, np.cumsum(counts))
    total, n = (np.diff(of[offset]) for of in (summed, number))
    away = total / np.sqrt(np.maximum(n, 1))
    away -= np.median(away)
    return away**2 <= AGREES**2 * np.median(away**2) / MEDIAN_OF_SQUARE


def _stacked(of_pixels: np.ndarray) -> np.ndarray:
    """Set the matrices of pixels one below the other."""
    n_pixel, n_row, n_column = of_pixels.shape
    return of_pixels.reshape(n_pixel * n_row, n_column)  # -1 would not do where nothing is unknown
