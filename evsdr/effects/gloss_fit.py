"""Finding gloss in event pairs: is there any, and which lobe has each kind of material.

Lobe and the unknowns of a sample of pixels are fitted together: what a matt fit has already explained by
wrong normals and reflectances would hide the lobe. The Schur complement eliminates the unknowns of each pixel.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.cluster.vq import kmeans2

from evsdr.effects.gloss_terms import Sample, eliminate
from evsdr.metrics import angular_error_deg
from evsdr.model.gloss import RoughCoating
from evsdr.solve.unknowns import LARGEST_STEP

MAX_KIND = 4  # of material
TOO_FEW = 2.0  # scatter of too few kinds, relative to that of MAX_KIND
MOST = 0.9  # share of pixels that a scatter speaks of
SAME_SPECTRUM = 0.05  # scatter of unit spectra that one material may have
N_STEP = 25  # Levenberg-Marquardt steps
LEAST_Z = 6.0  # score of gloss that is there
NEAR_DEG = 25.0  # from a half vector: where a lobe shows
KIND_SIGMA = (1.0, 0.5)  # of log strength and log shape of the kinds of one scene


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
    """

    kind: type
    shape: np.ndarray
    strength: np.ndarray
    label: np.ndarray

    def lobe(self, Float: type):
        """Lay the lobes out over the pixels."""
        return self.kind(*(Float(v[self.label].astype(np.float32)) for v in (self.shape, self.strength)))


@dataclass(frozen=True)
class Evidence:
    """What the residuals of a matt fit say of gloss, by Rao's score test.

    Attributes
    ----------
    shape, strength : float
        Of the lobe that explains them best.
    z : float
        Score in standard deviations, by its scatter over the pixels.
    error_deg : float
        Expected mean error of the normals if gloss is left out [deg].
    """

    shape: float
    strength: float
    z: float
    error_deg: float

    def is_worth_modelling(self, least_deg: float = 0.1) -> bool:
        """Tell whether gloss is there, and spoils normals by more than `least_deg`."""
        return self.strength > 0 and self.z > LEAST_Z and self.error_deg > least_deg


def gloss_evidence(
    problem, theta: np.ndarray, noise: float, kind: type = RoughCoating, view=None
) -> Evidence:
    """Ask the residuals of a matt fit for gloss.

    Gloss that a fit has already explained by wrong normals and reflectances counts too: these unknowns are
    eliminated, not held.

    Parameters
    ----------
    problem : problem.Problem
    theta : (n_pixel, 2 + n_band) float
        Slopes and log reflectances of the matt fit.
    noise : float
        Standard deviation of its relative residuals.
    view : Array3f, optional
        See `GlossyRing`.
    """
    sample = Sample(problem, np.ones(problem.n_pixel, bool), noise, view)
    theta = theta[sample.pixel]
    found = _best_score(sample, theta, kind)
    if found.strength > 0 and found.z > LEAST_Z:
        shape, strength, glossy = _descend(sample, theta, kind, found.shape, found.strength)
        error = angular_error_deg(_normals(theta), _normals(glossy)).mean()
        found = Evidence(shape, strength, found.z, float(error))
    return found


def fit_gloss(
    problem,
    theta: np.ndarray,
    noise: float,
    kind: type = RoughCoating,
    label=None,
    view=None,
) -> Gloss:
    """Fit one lobe per kind of material, together with the unknowns of a sample of its pixels.

    The lobe of all pixels is fitted first; that of a kind departs from it as its own pixels demand.

    Parameters
    ----------
    theta : (n_pixel, 2 + n_band) float
        Slopes and log reflectances to start from, of a matt fit or of an earlier glossy one.
    label : (n_pixel,) int, optional
        Kind of each pixel; by default one for all.

    Others as those of `gloss_evidence`.
    """
    label = np.zeros(problem.n_pixel, int) if label is None else label
    shape, strength = np.full(label.max() + 1, kind.STARTS[0]), np.zeros(label.max() + 1)
    near = near_half_vector(problem.illumination, theta, view)
    sample = Sample(problem, near, noise, view)
    common = _best_score(sample, theta[sample.pixel], kind) if len(sample.pixel) else None
    if common and common.strength > 0 and common.z > LEAST_Z:
        shape[:], strength[:], _ = _descend(sample, theta[sample.pixel], kind, common.shape, common.strength)
        for c in range(len(shape) if len(shape) > 1 else 0):
            sample = Sample(problem, near & (label == c), noise, view)
            if len(sample.pixel):
                given = shape[c], strength[c]
                shape[c], strength[c], _ = _descend(sample, theta[sample.pixel], kind, *given, KIND_SIGMA)
    return Gloss(kind, shape, strength, label)


def sort_materials(reflectance: np.ndarray, seed: int = 0) -> np.ndarray:
    """Sort pixels into 1..4 kinds by the shape of their spectra.

    The fewest kinds whose scatter is small in most pixels, or at most twice that of four kinds: four kinds of
    one material only share out its noise.

    Parameters
    ----------
    reflectance : (n_pixel, n_band) float

    Returns
    -------
    (n_pixel,) int
        Kinds from 0.
    """
    spectrum = reflectance / np.maximum(np.linalg.norm(reflectance, axis=1, keepdims=True), 1e-9)
    labels, scatters = [], []
    for k in range(1, MAX_KIND + 1):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty kind is no harm
            centre, label = kmeans2(spectrum, k, minit="++", seed=seed, iter=30)
        labels.append(np.unique(label, return_inverse=True)[1])
        scatters.append(np.quantile(np.sum((spectrum - centre[label]) ** 2, axis=1), MOST))
        if scatters[-1] <= SAME_SPECTRUM**2:
            return labels[-1]
    return next(label for label, s in zip(labels, scatters) if s <= TOO_FEW * scatters[-1])


def near_half_vector(illumination, theta: np.ndarray, view=None) -> np.ndarray:
    """Tell which pixels (n_pixel) have their normal near the half vector of an LED."""
    normal = _normals(theta)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    view = np.array([0.0, 0.0, 1.0]) if view is None else np.array(view).T
    cosine = np.full(len(normal), -1.0)
    for direction in illumination.direction:
        half = np.array(direction).T + view
        half /= np.linalg.norm(half, axis=-1, keepdims=True)
        cosine = np.maximum(cosine, np.sum(normal * half, axis=1))
    return cosine > np.cos(np.radians(NEAR_DEG))


def _score(sample: Sample, theta: np.ndarray, kind: type, shape: float) -> Evidence:
    """Score test of strength 0 against a lobe of that shape."""
    _, normal, gradient = sample.terms(theta, kind, shape, 0.0)
    matrix, score, _, coupled = eliminate(normal[:, :-1, :-1], gradient[:, :-1], 1)
    strength = float(-score.sum() / matrix.sum())
    z = float(-score.sum() / np.sqrt(np.sum(score**2)))
    moved = theta[:, :2] - np.clip(strength * coupled[:, :2, 0], -LARGEST_STEP[0], LARGEST_STEP[0])
    angle = angular_error_deg(_normals(theta), _normals(moved))
    return Evidence(shape, strength, z, float(angle.mean()))


def _best_score(sample: Sample, theta: np.ndarray, kind: type) -> Evidence:
    """Score test over some shapes."""
    return max((_score(sample, theta, kind, shape) for shape in kind.STARTS), key=lambda e: e.z)


def _descend(
    sample: Sample, theta: np.ndarray, kind: type, shape: float, strength: float, sigma=(np.inf, np.inf)
) -> tuple[float, float, np.ndarray]:
    """Fit shape and strength jointly with the pixels' unknowns from start values; gives all three.

    `sigma` is that of a prior on the logarithms of strength and shape, centred at the start values.
    """
    precision = np.power(sigma, -2.0)
    lobe, damping = np.log([strength, shape]), 1e-2
    centre = lobe

    def evaluate(theta, lobe):
        cost, *rest = sample.terms(theta, kind, *np.exp(lobe[::-1]))
        return cost + 0.5 * precision @ (lobe - centre) ** 2, *rest

    terms = evaluate(theta, lobe)
    for _ in range(N_STEP):
        cost, normal, gradient = terms[0], terms[1].copy(), terms[2].copy()
        strength = np.exp(lobe[0])  # the step is of its logarithm
        normal[:, -2] *= strength
        normal[..., -2] *= strength
        gradient[:, -2] *= strength
        diagonal = np.arange(normal.shape[1])
        normal[:, diagonal, diagonal] *= 1 + damping
        matrix, score, own, coupled = eliminate(normal, gradient, 2)
        matrix = matrix.sum(axis=0) + np.diag(precision)
        score = score.sum(axis=0) + precision * (lobe - centre)
        step = np.clip(-np.linalg.solve(matrix, score), -1.0, 1.0)
        move = own - coupled @ step
        limit = np.where(np.arange(move.shape[1]) < 2, *LARGEST_STEP)
        trial = theta + np.clip(move, -limit, limit)
        new = lobe + step
        new[1] = np.clip(new[1], *np.log(kind.RANGE))
        new_terms = evaluate(trial, new)
        if new_terms[0] < cost:
            gain = cost - new_terms[0]
            theta, lobe, terms, damping = trial, new, new_terms, max(damping * 0.2, 1e-6)
            if gain < 1e-5 * cost and np.abs(step).max() < 1e-2:
                break
        else:
            damping *= 8
    return float(np.exp(lobe[1])), float(np.exp(lobe[0])), theta


def _normals(theta: np.ndarray) -> np.ndarray:
    """Give vectors (n_pixel, 3) along the normals of slopes; their length is free."""
    return np.column_stack([-theta[:, 0], -theta[:, 1], np.ones(len(theta))])
