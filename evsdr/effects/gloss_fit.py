"""Finding gloss in event pairs: is there any, and which lobe has each kind of material.

A matt fit hides the lobe: it explains it by wrong normals, reflectances and thresholds. So a sample of pixels is solved
anew under every lobe that is tried; the one of smallest cost is found. Whether it is there say events that are held
back. What is wrong with a matt model comes again in every round, and a lobe so wide that it lights all normals alike
takes it up (slopes within a pixel, borders of shadows): gloss must explain events better than such a lobe does.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from evsdr.effects.sample import Sample, gained
from evsdr.metrics import angular_error_deg
from evsdr.model.arrays import owned, rows
from evsdr.model.gloss import GlossyRing, RoughCoating
from evsdr.model.illumination import Illumination
from evsdr.solve.problem import Problem
from evsdr.solve.unknowns import to_normal

N_SAMPLE = 400  # pixels that stand for all of a kind
STRENGTHS = (0.05, 0.2, 0.8)  # to start a search from; what is weaker hardly spoils normals
SETTLED = 0.01  # change of log shape and log strength that ends the search
LEAST_Z = 3.0  # of gloss that is there; measured: matt scenes reach 0, a coating of a fifth of its strength 5
N_NEAR, MOST_COST = 9, 10.0  # pixels of a sample that are of one material; guessed
MATT = ((1.0,), (0.0,))  # shape and strength of no lobe
LEAST_SHARE = 0.45  # of the pixels near a half vector that have a lobe; measured: sub-pixel slopes look so in 0.36 at most
N_REGION = 3000  # pixels that tell where lobes are
MATT_COST = 0.3  # in log likelihood that a lobe must cost pixels that have none; guessed
NEAR_DEG = 25.0  # from a half vector: where a lobe shows
MOST_SHIFT = 0.5  # of the logarithm of all thresholds; guessed
KIND_SIGMA = np.array([0.5, 1.0])  # of log shape and log strength of the kinds of one scene


@dataclass(frozen=True)
class Gloss:
    """Lobes, one for each kind of material.

    Attributes
    ----------
    kind : type
        `BlinnPhong` or `RoughCoating`.
    shape, strength : (n_kind,) float
        Of each kind; strength 0 is matt.
    label : (n_pixel,) int
        Kind of each pixel.
    log_threshold : float or (2,) float
        By how much the logarithms of thresholds are larger than told.
    """

    kind: type
    shape: np.ndarray
    strength: np.ndarray
    label: np.ndarray
    log_threshold: np.ndarray | float = 0.0

    def commonest(self, n_pixel: int) -> "Gloss":
        """Give the lobe of the commonest kind to other pixels, of those that have one if most pixels do."""
        count, lobed = np.bincount(self.label, minlength=len(self.shape)), self.strength > 0
        if 2 * count[lobed].sum() >= count.sum():
            count = count * lobed
        return replace(self, label=np.full(n_pixel, count.argmax()))

    def lobe(self, Float: type):
        """Lay the lobes out over the pixels."""
        return self.kind(*(owned(Float, v[self.label]) for v in (self.shape, self.strength)))


@dataclass(frozen=True)
class GlossEvidence:
    """What events that are held back say of gloss.

    Attributes
    ----------
    shape, strength : float
        Of the lobe that explains them best.
    z : float
        What the lobe gains over a matt surface or the widest lobe, see `sample.gained`.
    error_deg : float
        Expected mean error of the normals if gloss is left out [deg].
    log_reflectance : (n_band,) float
        The same of log reflectances, root mean square.
    """

    shape: float
    strength: float
    z: float
    error_deg: float
    log_reflectance: np.ndarray | float = 0.0

    def is_worth_modelling(self, least_deg: float = 0.1) -> bool:
        """Tell whether gloss is there, and spoils normals by more than `least_deg`."""
        return self.z > LEAST_Z and self.error_deg > least_deg


def gloss_evidence(
    problem: Problem,
    theta: np.ndarray,
    noise: float,
    kind: type = RoughCoating,
    spread: tuple | None = None,
    most: int = N_SAMPLE,
) -> GlossEvidence:
    """Ask the events for gloss.

    Parameters
    ----------
    problem : Problem
    theta : (n_pixel, n_unknown) float
        Unknowns of the matt fit, those of thresholds too if it has any.
    noise : float
        Standard deviation of its relative residuals.
    spread : tuple of 4 float, optional
        How its unknown thresholds are distributed.
    most : int
        Pixels, at most, that are asked.
    """
    pixel = _some(problem, np.ones(problem.n_pixel, bool), most)
    if len(pixel) == 0:
        return GlossEvidence(kind.WIDEST, 0.0, 0.0, 0.0)
    evidence, matt, glossy, there = _first_look(problem, pixel, theta, noise, kind, spread)
    if evidence.z > LEAST_Z:
        sample = Sample.of(problem, pixel[there], noise, spread)
        shape, strength, _, glossy = _search(sample, kind, glossy[there], evidence.shape, evidence.strength)
        error = angular_error_deg(to_normal(matt[there]), to_normal(glossy)).mean() * there.mean()
        bands = slice(2, 2 + problem.illumination.n_band)
        change = np.sqrt(np.mean((matt[there, bands] - glossy[:, bands]) ** 2, axis=0) * there.mean())
        evidence = GlossEvidence(shape, strength, evidence.z, float(error), change)
    return evidence


def fit_gloss(
    problem: Problem,
    theta: np.ndarray,
    noise: float,
    kind: type = RoughCoating,
    label: np.ndarray | None = None,
    spread: tuple | None = None,
    shifted: bool = False,
) -> Gloss:
    """Fit one lobe per kind of material, together with the unknowns of a sample of its pixels.

    The lobe of all pixels is fitted first, with what thresholds are in the mean: a matt fit takes gloss for smaller
    thresholds, and with these the lobe comes out weaker. The lobe of a kind departs from it as its own pixels demand.
    Regions whose events speak against a lobe are matt, a kind for itself.

    Parameters
    ----------
    theta : (n_pixel, n_unknown) float
        Unknowns to start from, of a matt fit or of an earlier glossy one.
    label : (n_pixel,) int, optional
        Kind of each pixel; by default one for all.
    shifted : bool
        Whether all thresholds may be larger or smaller than told.

    Others as those of `gloss_evidence`.
    """
    label = np.zeros(problem.n_pixel, int) if label is None else label
    shape, strength = np.full(label.max() + 1, kind.STARTS[0]), np.zeros(label.max() + 1)
    near = near_half_vector(problem.illumination, theta, problem.view)
    pixel, n_map = _some(problem, near), 2 + problem.illumination.n_band
    if len(pixel) == 0:
        return Gloss(kind, shape, strength, label)
    common, _, glossy, there = _first_look(problem, pixel, theta, noise, kind, spread)
    if common.z <= LEAST_Z:
        return Gloss(kind, shape, strength, label)
    sample, free = Sample.of(problem, pixel[there], noise), MOST_SHIFT if shifted else 0.0
    start = glossy[there, :n_map], common.shape, common.strength
    shape[:], strength[:], shift, _ = _search(sample, kind, *start, most_shift=free)
    there = glossy_regions(problem, theta[:, :n_map], noise, kind, (shape[0], strength[0]), shift)
    for c in range(len(shape) if len(shape) > 1 else 0):
        pixel = _some(problem, near & there & (label == c))
        if len(pixel):
            sample = Sample.of(problem, pixel, noise).with_thresholds(shift)
            start = theta[pixel, :n_map], shape[c], strength[c]
            shape[c], strength[c], *_ = _search(sample, kind, *start, KIND_SIGMA)
    if not there.all():  # one more kind, which is matt
        label = np.where(there, label, len(shape))
        shape, strength = np.append([shape, strength], MATT, axis=1)
    return Gloss(kind, shape, strength, label, shift)


def glossy_regions(
    problem: Problem, theta: np.ndarray, noise: float, kind: type, lobe: tuple, shift
) -> np.ndarray:
    """Tell which pixels (n_pixel) bool look as if they had a lobe, by the events of those around it, at borders by its own."""
    pixel = _some(problem, np.ones(problem.n_pixel, bool), N_REGION)
    sample = Sample.of(problem, pixel, noise).with_thresholds(shift)
    place = place_of(problem)
    from scipy.spatial import cKDTree  # late: few scenes are glossy

    tree = cKDTree(place[pixel])
    usual = np.median(theta[pixel][near_to(place[pixel])], axis=1)  # a wrong lobe has spoilt single pixels
    costs = [sample.solve(usual, _glossy(sample, kind, *given))[0] for given in ((lobe[0], 0.0), lobe)]
    matt, glossy = averaged(np.array(costs), place[pixel])
    there = glossy < matt + MATT_COST
    around = there[near_to(place[pixel])]
    at_border = around.any(axis=1) & ~around.all(axis=1)
    there = np.where(at_border, costs[1] < costs[0] + MATT_COST, there)
    return there[tree.query(place)[1]]


def near_half_vector(illumination: Illumination, theta: np.ndarray, view=None) -> np.ndarray:
    """Tell which pixels (n_pixel) have their normal near the half vector of an LED."""
    normal = to_normal(theta)
    view = np.array([0.0, 0.0, 1.0]) if view is None else rows(view)
    cosine = np.full(len(normal), -1.0)
    for direction in illumination.direction:
        half = rows(direction) + view
        half /= np.linalg.norm(half, axis=-1, keepdims=True)
        cosine = np.maximum(cosine, np.sum(normal * half, axis=1))
    return cosine > np.cos(np.radians(NEAR_DEG))


def _some(problem: Problem, candidate: np.ndarray, most: int = N_SAMPLE) -> np.ndarray:
    """Choose a sample of the candidates (n_pixel) bool that fired events, all over the image."""
    chosen = np.flatnonzero(candidate & (problem.pairs.counts > 0))
    n = min(most, len(chosen))
    return chosen[np.arange(n) * len(chosen) // max(n, 1)]


def _first_look(
    problem: Problem,
    pixel: np.ndarray,
    theta: np.ndarray,
    noise: float,
    kind: type,
    spread: tuple | None = None,
):
    """Compare some lobes with none and the widest: gives evidence, and unknowns (n_pixel, n) without and with the best.

    The lobes are told by the pairs that are not held back, the evidence by those that are.
    """
    no_gloss = [(kind.WIDEST, strength) for strength in (0.0, *STRENGTHS)]
    lobes = np.array([*no_gloss, *itertools.product(kind.STARTS, STRENGTHS)])
    n_lobe, n, n_not = len(lobes), len(pixel), len(no_gloss)
    sample = Sample.of(problem, np.tile(pixel, n_lobe), noise, spread)
    model = _glossy(sample, kind, *np.repeat(lobes, n, axis=0).T)
    cost, held, found = sample.hold_back(np.tile(theta[pixel], (n_lobe, 1)), model)
    cost, held = cost.reshape(n_lobe, n), held.reshape(n_lobe, n)
    found, each = found.reshape(n_lobe, n, -1), np.arange(n)
    around = averaged(cost, place_of(problem)[pixel])
    rival = np.argmin(around[:n_not], axis=0)
    near = near_half_vector(problem.illumination, theta, problem.view)[pixel]
    gain = (around[rival, each] - around[n_not:]) * near
    best = n_not + np.argmax(np.maximum(gain, 0).sum(axis=1))
    there = gain[best - n_not] > 0
    if there.sum() < LEAST_SHARE * near.sum():  # what is wrong with any model may look glossy in a few pixels
        there = near
    z, _ = gained(held[rival, each][there], held[best][there])
    error = angular_error_deg(to_normal(found[0]), to_normal(found[best])) * there
    glossy = np.where(there[:, None], found[best], found[0])
    return (
        GlossEvidence(*lobes[best].tolist(), z, float(error.mean()) if z > 0 else 0.0),
        found[0],
        glossy,
        there,
    )


def place_of(problem: Problem) -> np.ndarray:
    """Give row and column (n_pixel, 2) of each pixel."""
    return np.column_stack(np.nonzero(np.asarray(problem.grid.mask)))


def averaged(cost: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Average what pixels cost (..., n_pixel) over some that are near, no pixel above its least by more than `MOST_COST`."""
    return np.minimum(cost - cost.min(axis=0), MOST_COST)[:, near_to(place)].mean(axis=-1)


def near_to(place: np.ndarray) -> np.ndarray:
    """Number those (n_pixel, n) that are nearest to each place (n_pixel, 2), itself included."""
    from scipy.spatial import cKDTree  # late: few scenes are glossy

    return cKDTree(place).query(place, min(N_NEAR, len(place)))[1].reshape(len(place), -1)


def _glossy(sample: Sample, kind: type, shape, strength) -> GlossyRing:
    """Give the forward model of a sample under lobes, shape and strength a number or (n_pixel,)."""
    Float, n = type(sample.data.constant_light), len(sample.data.pairs.counts)
    lobe = kind(*(owned(Float, np.broadcast_to(v, n)) for v in (shape, strength)))
    return GlossyRing(sample.illumination, lobe, sample.view, sample.rough)


def _search(
    sample: Sample,
    kind: type,
    theta: np.ndarray,
    shape: float,
    strength: float,
    sigma: np.ndarray = np.inf,
    most_shift: float = 0.0,
) -> tuple[float, float, float, np.ndarray]:
    """Find the lobe of smallest cost, from start values, with the shift of log thresholds by `most_shift` at most.

    Gives its shape and strength, the shift, and the pixels' unknowns. `sigma` is that of a prior on the logarithms of shape and
    strength, centred at the start values.
    """
    from scipy.optimize import minimize  # late: few scenes are glossy

    centre, bounds, first = np.log([shape, strength]), [np.log(kind.RANGE), (-np.inf, np.inf)], [0.3, 0.3]
    if most_shift:
        bounds, first = [*bounds, (-most_shift, most_shift)], [*first, 0.1]
    start = np.append(centre, np.zeros(len(first) - 2))

    def solved(at):
        here = sample.with_thresholds(at[2]) if most_shift else sample
        return here.solve(theta, _glossy(sample, kind, *np.exp(at[:2])))

    def cost(at):
        nonlocal theta
        each, theta = solved(at)
        return each.sum() + 0.5 * np.sum(((at[:2] - centre) / sigma) ** 2)

    simplex = start + np.vstack([np.zeros(len(start)), np.diag(first)])
    options = {"initial_simplex": simplex, "xatol": SETTLED, "fatol": np.inf}
    best = minimize(cost, start, method="Nelder-Mead", bounds=bounds, options=options).x
    _, theta = solved(best)
    return *np.exp(best[:2]).tolist(), float(best[2]) if most_shift else 0.0, theta
