"""What all pixels share, inferred together with the maps of some pixels.

Steps of both are damped (Marquardt 1963). Scatter of the events, spread of the thresholds, and which pixels are heard
are learnt between rounds of steps.
"""

from dataclasses import dataclass, replace

import numpy as np

from evsdr.records import Recording
from evsdr.solve.background import Activity, least_residual
from evsdr.solve.noise import MISFIT
from evsdr.solve.shared.pixels import Pixels
from evsdr.solve.shared.posterior import LEARNT, SLACK, Point, Posterior, Start, bounded
from evsdr.solve.shared.replica import replica, takes_long
from evsdr.solve.shared.rig import CONSIDERED, GROUPS, NAMES, TIMES, Basis, Rig, Told
from evsdr.solve.shared.robust import covariance, kinds
from evsdr.solve.unknowns import normal_sigma_deg, to_normal

N_ROUND, N_STEP = 12, 4  # of steps with one scatter, at most; guessed: the last ones hardly move anything
UNKNOWN = tuple(name for name in NAMES if name != CONSIDERED)
RISEN = 0.01  # mean loss of that from which a step is refused
SETTLED = (
    0.15  # standard deviations of what is shared, root mean square, by which a step goes when it is the last
)
# Rounds after which a scatter that contradicts the model ends a search; guessed. Measured (`experiments.draws`), after four: .25 at most in 0 to 9, .32 where
# frames were interpolated (1094), .49 in 1132 and 1153, which are contradicted, 1.0 to 1.5 where events of whole edges come within a frame (1149)
IN_VAIN = 4
STILL = 0.98  # of the larger of the scatters before and after a last round, the smaller; guessed
# Standard deviations of noise to which it is known how early that fires events, see `events.lead`; measured under LEDs that are bright
# and dark in turn: all times are found 100 to 210 us late that are not, where this, by the median slot's light, is 90
LEAD = 0.2
# Standard deviations that a lag is from the quickest where a search ends early, as there is none; guessed. Measured with 1 us for the quickest: scatter
# of thresholds of 20 to 40 % ends there with sigmas of .4 to 2 us
SURE = 4.0
# Tolerances of powers and directions from which they are known hardly better than told; guessed. Measured of powers: .35 to 2 on planes
# whose powers are not as told or seem so, .03 to .1 on spheres, blobs, reliefs and on charts under right powers, .07 to .23 on
# sculptures, but for a glossy one in two rounds of square LEDs 10 % off: .5
VAGUE = 0.3
# Of which a search is off by something of its own. Measured of the distance, of spheres of radius 1 before near LEDs (as of
# `experiments.draws`, 420, --but shape=sphere known=False): thresholds that scatter by 2 and 20 % make it .03 and .06 to .13 too short, and
# normals .42 and 2.1 to 2.4 degrees off as found; with it and with steps that are not damped .17 and .34 to .41
OWN = *TIMES, "thresholds", "distance"
# Rounds of a search in simulated events, at most. Measured (`experiments.shared`, slots of 5 and 2 ms, LEDs that switch): with 4 steps in all normals
# .164 .162 .162 degrees, with these .145 .155 .151
OWN_ROUND = 4
MOST_OFF = 6.0  # standard deviations by which, at most; guessed
UNSURE = 0.5  # of a correction, that sigmas hold; guessed
FIRST_DAMPING, DAMPING_RANGE = 1e-3, (1e-6, 1e6)
FIRST_STIFFNESS, MOST_STIFFNESS = 1e-2, 1e3


@dataclass(frozen=True)
class Inferred:
    """What was inferred.

    Attributes
    ----------
    rig, sigma : Rig
        Values, and their standard deviations, see `robust`.
    theta, spread, scatter, departs
        See `Start`.
    turn_deg : dict of str to float
        By which mean angle the normals of these pixels turn because of each of `rig.GROUPS`.
    wanted : dict of str to float
        Of timing that was left at 0: how many standard deviations above that the events want it.
    moved_deg : float
        The same because of all that differs from where the search started.
    n_step : int
    normal_sigma_deg : float
        What all this leaves open of the normals, of the median pixel.
    log_reflectance_sigma : (n_band,) float
        The same of log reflectances, with the gain of each band.
    response : (n_pixel, n, n_free) float
        How the unknowns of pixels follow what is shared, along `Basis`.
    no_lag : bool
        Whether photoreceptors are as quick as can be, so none of an event camera.
    lead : float
        What it amounts to that it is not known better how early noise fires events [slots].
    doubted : tuple of str
        Of `rig.NAMES`: what may as well be as told, which what is left open of maps holds.
    surprise : float
        Minus the logarithm of the evidence, by Laplace's method, but for a constant: what all cost, and how small a part of what maps can
        be explains the events.
    """

    rig: Rig
    sigma: Rig
    theta: np.ndarray
    spread: np.ndarray
    scatter: float
    departs: float
    turn_deg: dict
    wanted: dict
    moved_deg: float
    n_step: int
    normal_sigma_deg: float
    log_reflectance_sigma: np.ndarray
    response: np.ndarray
    no_lag: bool = False
    lead: float = 0.0
    doubted: tuple[str, ...] = ()
    surprise: float = 0.0

    @property
    def in_vain(self) -> bool:
        """Whether events and model contradict each other whatever pixels share."""
        return self.scatter > MISFIT


def infer(
    pixels: Pixels,
    start: Start,
    told: Rig,
    tolerance: Told = Told(),
    names: tuple[str, ...] = UNKNOWN,
    activity: Activity | None = None,
) -> Inferred:
    """Infer what pixels share, together with their maps.

    Parameters
    ----------
    told : Rig
        What is told of them; no tau and no noise are 0.
    tolerance : Told
        How well.
    names : tuple of str
        Of `UNKNOWN`, or some of them: what is unknown. The rest stays as told.
    activity : Activity, optional
        How many events come by chance; those that do by the start are left out.
    """
    posterior = _posterior(pixels, start, told, tolerance, names)
    begin = posterior.basis.vectors.T @ start.rig.vector
    point = posterior.at(start.theta, begin)
    if activity:
        u = point.residual
        pixels = pixels.without(u < least_residual(u[np.isfinite(u)], activity))
        posterior = replace(posterior, pixels=pixels)
        point = posterior.at(start.theta, begin)
    posterior = replace(posterior, weigh=point.variance)
    posterior, point, n_step = _settle(posterior, point, tolerance)
    ended = (point.free == 0) & (posterior.centre > 0)
    if ended.any():  # from one end of its range a search may not come back
        free = np.where(ended, posterior.centre, point.free)
        again = posterior.at(point.theta, free, departure=point.departures.value)
        other, new, more = _settle(posterior, again, tolerance)
        n_step += more
        if _cost(other, other.again(new)) < _cost(posterior, posterior.again(point)):
            posterior, point = other, new
    left = [name for name in TIMES if name not in (*names, CONSIDERED) and getattr(told, name) == 0]
    posterior = replace(posterior, stirred=(*names, *left))
    posterior, point, response, around = _known(posterior, point, tolerance)
    away, owner = point.free - posterior.centre, posterior.basis.owner
    turn = {
        group: turn_deg(point.theta, response @ np.where(np.isin(owner, of_group), away, 0))
        for group, of_group in GROUPS.items()
    }
    doubted = _doubted(posterior, around)
    wide = around + _between(posterior, away, doubted)
    open_deg, log_reflectance_sigma = _left_open(point.theta[:, : posterior.n_map], response, wide)
    sigma = np.sqrt(np.einsum("ij,jk,ik->i", posterior.basis.vectors, around, posterior.basis.vectors))
    return Inferred(
        posterior.rig(point.free),
        Rig.of(sigma, pixels.light.n_led),
        point.theta,
        posterior.spread,
        posterior.scatter,
        posterior.departs,
        turn,
        {name: posterior.wanted(point, tolerance, name) for name in left},
        turn_deg(point.theta, response @ (point.free - begin)),
        n_step,
        open_deg,
        np.hypot(log_reflectance_sigma, _gain_sigma(posterior)),
        response,
        posterior.lacks_lag(point),
        _lead(posterior, point),
        doubted,
        _cost(posterior, point) + _narrowness(point),
    )


def own_bias(
    found: Inferred, pixels: Pixels, recording: Recording, tolerance: Told, names: tuple[str, ...]
) -> np.ndarray:
    """Give what a search is off by of times, thresholds and the distance, along `Basis.of(names)`, see `replica`.

    Counted as far as it is beyond noise: as Wiener's filter has it (1949), squares over squares and noise.

    Parameters
    ----------
    pixels : Pixels
        Those of which it was found.
    recording : Recording
        Theirs.
    tolerance, names
        Of the search.
    """
    at = found.theta, found.rig, found.scatter, found.departs
    new = None if takes_long(pixels, recording, *at[:2]) else replica(pixels, recording, *at)
    if new is None:
        return np.zeros(len(Basis.of(names, pixels.light.band).owner))
    posterior = _posterior(new, Start(*at[:2], found.spread, *at[2:]), found.rig, tolerance, names)
    true = posterior.basis.vectors.T @ found.rig.vector
    point = posterior.at(found.theta, true)
    posterior = replace(posterior, weigh=point.variance)
    posterior, point, _ = _settle(posterior, posterior.again(point), tolerance, OWN_ROUND)
    noise = np.diag(np.linalg.inv(posterior.solve(point)[3]))
    off = np.where(np.isin(posterior.basis.owner, OWN), point.free - true, 0)
    most = MOST_OFF * np.abs(posterior.basis.vectors.T @ found.sigma.vector)
    return np.clip(off**3 / (off**2 + noise), -most, most)


def corrected(found: Inferred, off: np.ndarray, pixels: Pixels, names: tuple[str, ...]) -> Inferred:
    """Take off what a search is off by, as `own_bias` gives it; the pixels' maps follow."""
    basis = Basis.of(names, pixels.light.band)
    before = basis.vectors.T @ found.rig.vector
    after = bounded(before - off, basis, pixels)
    rig = Rig.of(found.rig.vector + basis.vectors @ (after - before), pixels.light.n_led)
    theta = found.theta + found.response @ (after - before)
    return less_sure(replace(found, rig=rig, theta=theta), UNSURE * off, basis)


def less_sure(found: Inferred, by: np.ndarray, basis: Basis) -> Inferred:
    """Add to the sigmas, and to what is left open of maps, that what is shared may be off by (n_free,), along the basis of the search."""
    n_led, n_band = len(found.rig.log_power), len(found.log_reflectance_sigma)
    theta = found.theta[:, : 2 + n_band]
    open_deg, log_reflectance_sigma = _left_open(theta, found.response, np.outer(by, by))
    return replace(
        found,
        sigma=Rig.of(np.hypot(found.sigma.vector, basis.vectors @ by), n_led),
        normal_sigma_deg=float(np.hypot(found.normal_sigma_deg, open_deg)),
        log_reflectance_sigma=np.hypot(found.log_reflectance_sigma, log_reflectance_sigma),
    )


def _doubted(posterior: Posterior, around: np.ndarray) -> tuple[str, ...]:
    """Name what is known of the LEDs hardly better than it is told.

    There the scene has a valley: on a plane powers, normal and reflectance are too many for what all its pixels say alike.
    """
    out = []
    for name in LEARNT:
        of = posterior.basis.owner == name
        told = posterior.told_sigma[of]
        if np.sum(np.diag(around)[of]) > np.sum((VAGUE * told) ** 2):
            out.append(name)
    return tuple(out)


def _between(posterior: Posterior, away: np.ndarray, doubted: tuple[str, ...]) -> np.ndarray:
    """Give the covariance (n_free, n_free) of values of which that told and that found are equally likely, and one was taken."""
    between = [np.where(posterior.basis.owner == name, away, 0) for name in doubted]
    return sum((np.outer(one, one) for one in between), np.zeros((len(away), len(away))))


def _gain_sigma(posterior: Posterior) -> np.ndarray:
    """Give how well the gain (n_band,) of each band is told, of the logarithm: as the mean of its LEDs, if each is told alike.

    No event tells it; but how well powers are told shows in how far those of a band are from each other.
    """
    band, sigma = np.array(posterior.pixels.light.band), posterior.sigma[posterior.basis.owner == "powers"]
    each = sigma.mean() if len(sigma) else 0.0
    return each / np.sqrt(np.maximum(np.bincount(band, minlength=posterior.pixels.light.n_band), 1))


def _known(posterior: Posterior, point: Point, tolerance: Told) -> tuple:
    """Give the posterior with all derivatives, the point, how maps respond, and the covariance of what is shared."""
    posterior = replace(posterior, stirred=(*posterior.stirred, CONSIDERED))
    point, slope = posterior.by_kind(point, kinds(posterior.pixels.events))
    _, response, _, complement = posterior.solve(point)
    heard = posterior.heard
    around = covariance(slope[heard], response[heard], posterior.vectors, complement)
    return posterior, point, response, around + posterior.considered(point, tolerance, CONSIDERED)


def _lead(posterior: Posterior, point: Point) -> float:
    """Give the time in which light changes by as much as `LEAD` of the noise, where events come [slots]."""
    rig = posterior.rig(point.free)
    return LEAD * rig.noise / posterior.pixels.speed(point.theta[:, : posterior.n_map], rig)


def _no_lag(posterior: Posterior, point: Point, around: np.ndarray) -> bool:
    """Tell whether photoreceptors surely are none of an event camera."""
    sigma = np.sqrt(np.diag(around)[posterior.basis.owner == "tau"])
    return posterior.lacks_lag(point) and bool((SURE * sigma < posterior.pixels.quickest).all())


def _settle(
    posterior: Posterior, point: Point, tolerance: Told, n_round: int = N_ROUND
) -> tuple[Posterior, Point, int]:
    """Make rounds of steps, and learn between them; gives the steps made, too.

    A lag that is none ends them, that no step helps, and that events and model contradict each other whatever pixels share.
    """
    damped, n_step, no_lag = Damping(np.full(len(point.theta), FIRST_DAMPING)), 0, False
    for k in range(n_round):
        start = posterior.again(point)
        point, damped, length, made = _descend(posterior, start, damped)
        stuck = point is start and damped.shared >= MOST_STIFFNESS
        before, posterior, n_step = posterior.scatter, posterior.learnt(point), n_step + made
        had_none, no_lag = no_lag, posterior.lacks_lag(point)
        if no_lag:
            no_lag = _no_lag(posterior, point, _known(posterior, point, tolerance)[-1])
        still = STILL < posterior.scatter / before < 1 / STILL
        if had_none and no_lag or (length < SETTLED or stuck) and still:
            break
        if k + 1 >= IN_VAIN and posterior.scatter > MISFIT:
            break
    return posterior, point, n_step


def _cost(posterior: Posterior, point: Point) -> float:
    """Give what all pixels cost at a point of this posterior, with what is told of what they share."""
    return float(point.cost.sum() + 0.5 * np.sum(((point.free - posterior.centre) / posterior.sigma) ** 2))


def _narrowness(point: Point) -> float:
    """Give minus the logarithm of the volume of what maps and thresholds of all pixels may be, but for a constant."""
    n = point.theta.shape[1]
    return float(0.5 * np.linalg.slogdet(point.matrix[:, :n, :n])[1].sum())


def _posterior(pixels: Pixels, start: Start, told: Rig, tolerance: Told, names: tuple[str, ...]) -> Posterior:
    """Set the posterior up."""
    basis, vector = Basis.of(names, pixels.light.band), told.vector
    width = tolerance.tolerance(pixels.slot_us)
    centre, sigma = basis.vectors.T @ vector, np.array([width[name] for name in basis.owner])
    return Posterior(
        pixels,
        basis,
        sigma=sigma,
        told_sigma=sigma,
        told=vector - basis.vectors @ centre,
        centre=centre,
        own_thresholds=start.theta.shape[1] > 2 + pixels.light.n_band,
        tilted="directions" in names,
        stirred=tuple(names),
        scatter=start.scatter,
        spread=np.asarray(start.spread, float),
        weigh=np.zeros(pixels.n_event),
        heard=np.ones(len(start.theta), bool),
        departs=start.departs,
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
    """Make steps until they are short; gives the last point, damping, its length in `SETTLED`, and the steps.

    The length is Newton's decrement (Boyd and Vandenberghe 2004, eq. 9.29), of a step about as long as without damping.
    """
    for made in range(1, N_STEP + 1):
        step, response, rest, complement = posterior.solve(point, damping.pixel, damping.shared)
        step = posterior.within(point.free, step, complement, damping.shared)
        new = posterior.moved(point, step, response, rest)
        worse = new.cost - point.cost > SLACK
        if worse.any():
            new = posterior.kept(point, new, worse)
        refused = posterior.risen(point, new) > RISEN
        step = (new.free - point.free) * (1 + damping.shared)  # what must not be negative may have ended at 0
        damping = damping.after(worse, refused)
        length = np.sqrt(step @ complement @ step / max(len(step), 1))
        if not refused:
            point = new
        if length < SETTLED:
            break
    return point, damping, length, made


def _left_open(theta: np.ndarray, response: np.ndarray, around: np.ndarray) -> tuple[float, np.ndarray]:
    """Give what the covariance of what is shared makes of the maps; see `Inferred`."""
    n_map = theta.shape[1]
    of_maps = np.einsum("nij,jk,nlk->nil", response[:, :n_map], around, response[:, :n_map], optimize=True)
    angle = normal_sigma_deg(theta[:, 0], theta[:, 1], of_maps[:, :2, :2])
    variance = np.median(np.diagonal(of_maps, axis1=1, axis2=2)[:, 2:], axis=0)
    return float(np.median(angle)), np.sqrt(np.maximum(variance, 0))


def turn_deg(theta: np.ndarray, move: np.ndarray) -> float:
    """Give the mean angle [deg] by which a move turns normals."""
    before, after = to_normal(theta), to_normal(theta + move)
    return float(np.degrees(np.linalg.norm(after - before, axis=1)).mean()) if len(theta) else 0.0
