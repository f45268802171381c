"""What pixels tell of each other: priors whose strength the data decide.

- normal: second differences of its x and y are small. Student's t, so that edges stay.
- integrable: slopes are those of a surface, so that their sum around four pixels is 0. Student's t, since
  surfaces may be torn.
- reflectance: second differences of its logarithm are small. Student's t with a full covariance between the
  bands, so that a texture of one colour counts once.
- spectra: reflectances lie near few directions, see `spectra`.

Gauss-Newton steps on all pixels together find the largest posterior; each is solved by conjugate gradients,
preconditioned pixel by pixel. Between steps, expectation maximisation learns the scales (`student`). Random
draws from the posterior around its maximum give the standard deviations (Papandreou and Yuille 2010, Gaussian
sampling by local perturbations).
"""

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import numpy as np
from scipy import ndimage

from evsdr.frozen import recorded
from evsdr.solve import triangles
from evsdr.solve.grid import Grid, Links
from evsdr.solve.neighbours import system as joint
from evsdr.solve.neighbours.priors import Learnt, Prior, integrable, smooth_normals, smooth_reflectance
from evsdr.solve.neighbours.spectra import Spectra, learn_spectra
from evsdr.solve.neighbours.student import learn_scatter, update_scatter
from evsdr.solve.unknowns import Unknowns

PARTS = ("normal", "integrable", "reflectance", "spectra")
N_LEARN = 2000  # pixels that teach
SHARPEST = 0.2  # smallest scale of a prior, relative to the noise of single pixels
LARGEST_MOVE = 1.0  # of an unknown per Gauss-Newton step
SLACK = 1.0  # log likelihood that a pixel may lose beyond what a step predicts
REJECTED, RELAXED, UNDAMPED = (
    0.5,
    0.25,
    0.01,
)  # damping after a step that was refused; factor after a good one; none
POOL = 5  # width of the window over which draws are averaged [pixels]


@dataclass(frozen=True)
class Priors:
    """Which priors count, and how long to look.

    Attributes
    ----------
    parts : tuple of str
        Of `PARTS`.
    n_round : int
        Gauss-Newton steps at most.
    tolerance : float
        Gain in log posterior of the mean pixel that is worth a step.
    n_draw : int
        Random draws.
    seed : int
        Of the draws.
    """

    parts: tuple = PARTS
    n_round: int = 6
    tolerance: float = 0.1
    n_draw: int = 8
    seed: int = 0


@dataclass(frozen=True)
class Posterior:
    """What data and priors say together.

    Attributes
    ----------
    theta : list of Float, (n_unknown)
        Unknowns where the posterior is largest.
    covariance : (n_pixel, n_unknown, n_unknown) float64
        Of each pixel's unknowns.
    scale : dict of str to float
        Typical second difference of the normal, sum of slopes around a square times n_z^2, and second
        difference of log reflectance; rank of the spectra. Only of priors that count.
    n_round : int
        Gauss-Newton steps made.
    open : float
        0 if they ended by the tolerance, else 1.
    """

    theta: list
    covariance: np.ndarray
    scale: dict
    n_round: int
    open: float


def find_posterior(
    theta: list,
    terms_at: Callable,
    grid: Grid,
    unknowns: Unknowns,
    priors: Priors,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Posterior:
    """Let pixels learn from each other.

    Parameters
    ----------
    theta : list of Float, (n_unknown)
        Unknowns as single pixels know them.
    terms_at : callable (theta) -> (cost, gradient, matrix)
        Terms of the data, as `loss.pixel_terms` gives them.
    grid : Grid
        Neighbours.
    unknowns : Unknowns
        What they mean.
    priors : Priors
        Which priors count.
    """
    Float, links = type(theta[0]), grid.links
    rng = np.random.default_rng(priors.seed)
    sample = rng.permutation(dr.width(theta[0]))[:N_LEARN]
    data = terms_at(theta)
    inverse = _invert(data[2])
    scales = [
        scale
        for scale in (
            Scale.learn(prior, theta, inverse, links, sample) for prior in _chosen(priors, unknowns)
        )
        if scale is not None
    ]
    spectra = _learn_spectra(theta, inverse, unknowns, sample) if "spectra" in priors.parts else None
    colours = spectra and spectra.arrays(Float)
    damping = dr.zeros(Float, dr.width(theta[0]))
    dr.make_opaque(damping)
    still_open = 1.0
    for round_ in range(priors.n_round + 1):
        forms = joint.weigh([scale.learnt(Float) for scale in scales], theta, inverse, links)
        gradient, matrix = data[1], data[2]
        if spectra:
            gradient, matrix = joint.add_spectra(colours, theta, gradient, matrix, inverse)
        *parts, inverse = joint.make_system(forms, matrix, damping, links)
        if round_ == priors.n_round or not still_open:
            break
        system = joint.JointSystem(parts[0], forms, *parts[1:])
        right = joint.right_side(forms, theta, gradient, links)
        move, trial, gain = _move(theta, joint.solve(system, right, links), right)
        theta, data, damping = _accept(theta, data, damping, move, trial, terms_at(trial))
        scales = [scale.update(theta, inverse, links, sample) for scale in scales]
        still_open = float(float(gain[0]) > priors.tolerance * dr.width(theta[0]))
        progress("neighbours", (round_ + 1) / (priors.n_round + 1))
    *parts, inverse = joint.make_system(forms, matrix, dr.zeros(Float, dr.width(theta[0])), links)
    system = joint.JointSystem(parts[0], forms, *parts[1:])
    covariance = _covariance(system, inverse, grid, rng, priors.n_draw, progress)
    found = {scale.prior.name: scale.typical for scale in sorted(scales, key=lambda scale: scale.prior.name)}
    if spectra:
        found["rank"] = spectra.rank
    return Posterior(theta, covariance, found, round_, still_open)


def _chosen(priors: Priors, unknowns: Unknowns) -> list[Prior]:
    all_of_them = smooth_normals(), integrable(), smooth_reflectance(unknowns.n_band)
    return [prior for prior in all_of_them if prior.name in priors.parts]


@recorded
def _move(theta: list, step: list, right: list):
    """Limit a step; gives it, where it leads, and what the posterior should gain by it."""
    move = [dr.clip(s, -LARGEST_MOVE, LARGEST_MOVE) for s in step]
    gain = dr.sum(0.5 * sum(m * r for m, r in zip(move, right)))
    return move, [t + m for t, m in zip(theta, move)], gain


@recorded
def _accept(theta: list, data: tuple, damping, move: list, trial: list, new: tuple):
    """Take a step where the data's cost does not rise by much more than expected; damp the others."""
    curved = triangles.multiply(data[2], move)
    expected = sum(m * (g + 0.5 * c) for m, g, c in zip(move, data[1], curved))
    good = new[0] - data[0] <= dr.maximum(2 * expected, 0) + SLACK
    damping = dr.select(good, damping * RELAXED, dr.maximum(damping * 6, REJECTED))
    damping = dr.select(damping < UNDAMPED, 0, damping)
    theta = [dr.select(good, a, b) for a, b in zip(trial, theta)]
    cost = dr.select(good, new[0], data[0])
    rest = [[dr.select(good, a, b) for a, b in zip(*two)] for two in zip(new[1:], data[1:])]
    return theta, (cost, *rest), damping


@recorded
def _invert(triangle: list) -> list:
    return triangles.invert(*triangles.factor(triangle))


# ---------------------------------------------------------------------- how strong priors are


@dataclass(frozen=True)
class Scale:
    """How strong a prior is: the covariance of the differences that it wants small, and the least of it."""

    prior: Prior
    spread: np.ndarray
    floor: np.ndarray

    @classmethod
    def learn(cls, prior: Prior, theta, inverse, links: Links, sample: np.ndarray) -> "Scale | None":
        """Learn from noisy single pixels; None where there is no difference to learn from."""
        z, noise = differences(prior, theta, inverse, links, sample)
        if not len(z):
            return None
        floor = SHARPEST**2 * np.diag(np.median(np.diagonal(noise, axis1=1, axis2=2), axis=0))
        return cls(prior, learn_scatter(z, noise, floor, about_zero=True)[1], floor)

    def update(self, theta, inverse, links: Links, sample: np.ndarray) -> "Scale":
        """Learn from posterior means and covariances."""
        z, left = differences(self.prior, theta, inverse, links, sample)
        return Scale(self.prior, update_scatter(z, left, self.spread, self.floor), self.floor)

    def learnt(self, Float: type) -> Learnt:
        return Learnt.of(self.prior, self.spread, Float)

    @property
    def typical(self) -> float:
        """Root mean square of a component."""
        return float(np.sqrt(np.trace(self.spread) / len(self.spread)))


def differences(prior: Prior, theta: list, inverse: list, links: Links, sample: np.ndarray):
    """Give differences (n, d) at some pixels, and their covariances (n, d, d) if pixels are independent."""
    parts, valid = _differences(prior, theta, inverse, links)
    values, factor, covariance = parts
    factor = np.broadcast_to(_numpy(factor), (dr.width(theta[0]),))
    covariance = np.array([[_numpy(c)[sample] for c in row] for row in covariance], float)
    z, noise = [], []
    for components, products, there in zip(values, prior.products(), valid):
        some = there.numpy()[sample]
        scale = factor[sample][some].astype(float)
        z.append(scale[:, None] * np.stack([_numpy(c)[sample][some] for c in components], axis=-1))
        own = np.zeros((len(scale), prior.size, prior.size))
        for i, j, k, m, stencil in products:
            own[:, i, j] += sum(stencil.weight.values()) * covariance[k, m][some]
        noise.append(own * scale[:, None, None] ** 2)
    return np.concatenate(z), np.concatenate(noise)


@recorded
def _differences(prior: Prior, theta: list, inverse: list, links: Links):
    values = prior.values(prior.quantities(theta), links)
    return (values, prior.factor(theta, links), prior.covariance(theta, inverse)), prior.valid(links)


def _numpy(value) -> np.ndarray:
    return np.asarray(value) if isinstance(value, float) else value.numpy()


def _learn_spectra(theta: list, inverse: list, unknowns: Unknowns, sample: np.ndarray) -> Spectra | None:
    bands = range(2, unknowns.n_map)
    log_r = np.stack([theta[i].numpy()[sample] for i in bands], axis=-1).astype(float)
    r, noise = np.exp(log_r), triangles.block(inverse, bands, sample)
    return learn_spectra(r, noise * r[:, :, None] * r[:, None, :])


# ---------------------------------------------------------------------- how well unknowns are known


def _covariance(system, inverse: list, grid: Grid, rng, n_draw: int, progress) -> np.ndarray:
    """Scale the blocks' inverses (n_pixel, n, n) so that their diagonals are what draws show, pooled."""
    single = triangles.block(inverse, range(len(system.pivot)), slice(None))
    variance = np.diagonal(single, axis1=1, axis2=2)
    ratio = np.zeros_like(variance)
    for k in range(n_draw):
        x = joint.solve(system, joint.draw(rng, system, grid.links), grid.links)
        ratio += np.square(np.stack([v.numpy() for v in x], axis=-1), dtype=float) / variance / n_draw
        progress("draws", (k + 1) / n_draw)
    factor = np.sqrt(_pool(ratio, grid.mask)) if n_draw else np.ones_like(ratio)
    factor[:, :2] = np.sqrt(np.mean(factor[:, :2] ** 2, axis=1, keepdims=True))
    return single * factor[:, :, None] * factor[:, None, :]


def _pool(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Average (n_pixel, n) over windows of the image."""
    weight = ndimage.uniform_filter(mask.astype(float), POOL)[mask]
    out = np.empty_like(values)
    for i, column in enumerate(values.T):
        image = np.zeros(mask.shape)
        image[mask] = column
        out[:, i] = ndimage.uniform_filter(image, POOL)[mask] / weight
    return out
