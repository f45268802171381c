"""What pixels tell of each other: priors whose strength the data decide.

- normal: second differences of its x and y are small. Student's t, so that edges stay.
- integrable: slopes are those of a surface, so that their sum around four pixels is 0. Student's t, since
  surfaces may be torn.
- reflectance: second differences of its logarithm are small. Student's t with a full covariance between the
  bands, so that a texture of one colour counts once.
- spectra: colours lie near few directions, see `spectra`.

Gauss-Newton steps on all pixels together find the largest posterior, first without edges; each is solved by conjugate
gradients, preconditioned pixel by pixel. Between steps, expectation maximisation learns the scales (`student`). Random draws
from the posterior around its maximum give the standard deviations (Papandreou and Yuille 2010, Gaussian sampling by local
perturbations). What each prior pulls counts beside it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import drjit as dr
import numpy as np
from scipy import ndimage

from evsdr.frozen import recorded
from evsdr.model.arrays import owned, picked
from evsdr.progress import Progress, silent
from evsdr.solve import triangles
from evsdr.solve.grid import Grid, Links
from evsdr.solve.neighbours import system as joint
from evsdr.solve.neighbours.priors import Learnt, Prior, integrable, smooth_normals, smooth_reflectance
from evsdr.solve.neighbours.spectra import Spectra, is_known, learn_spectra
from evsdr.solve.neighbours.student import FREEDOM, learn_scatter, update_scatter
from evsdr.solve.unknowns import Unknowns

PARTS = ("normal", "integrable", "reflectance", "spectra")
N_LEARN = 2000  # pixels that teach
SHARPEST = 0.2  # smallest scale of a prior, relative to the noise of single pixels
LARGEST_MOVE = 1.0  # of an unknown per Gauss-Newton step
# Steps at first, which take all differences for those of one surface (graduated non-convexity, Blake and Zisserman 1987):
# where single pixels know their scale badly, the posterior has many maxima. Measured on white, grey and textured spheres:
# 5 leave white ones 20 % worse, 12 gain nothing
N_SMOOTH, WITHOUT_EDGES = 8, 1e4
LOST = 10.0  # log likelihood that neighbours may cost a pixel in these, else it starts from its own events; measured: 10, 30 alike
# Log likelihood that a pixel may lose in a step beyond what that predicts; measured: with 1 white spheres and edges stay
# where they are (R off by 0.34 instead of 0.03)
SLACK = 1000.0
# Damping after a step that was refused; factor after a good one; none
REJECTED, RELAXED, UNDAMPED = 0.5, 0.25, 0.01
# Residuals at which conjugate gradients end, of the steps at first and of all others; measured on a blob of 128 x 128: 0.01
# and 0.01 give 0.241 degrees, 0.1 and 0.1 0.260, 0.1 and 0.03 0.244; on a white sphere 0.03 of the others gives RMSE 0.050, 0.01 0.031
ROUGHLY, EXACTLY = 0.1, 0.01
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
    progress: Progress = silent,
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
    inverse = _invert(triangles.added(data[2], unknowns.prior(theta, [], 1.0)[2]))
    learnt = [Scale.learn(prior, theta, inverse, links, sample) for prior in _chosen(priors, unknowns)]
    scales = [scale for scale in learnt if scale]
    spectra = _learn_spectra(theta, inverse, unknowns, links, sample) if "spectra" in priors.parts else None
    damping = dr.zeros(Float, dr.width(theta[0]))
    dr.make_opaque(damping)
    now = first = Climb(theta, data, damping, inverse, scales)
    colours, made = spectra and spectra.arrays(Float), 0
    for freedom, most, tolerance in (
        (WITHOUT_EDGES, N_SMOOTH, ROUGHLY),
        (FREEDOM, priors.n_round, EXACTLY),
    ):
        now = _where_events_agree(now, first) if made else now
        freedom = dr.opaque(Float, freedom)
        for _ in range(most):
            now, gain = _climb(now, terms_at, freedom, colours, links, sample, tolerance)
            made += 1
            still_open = float(gain > priors.tolerance * dr.width(damping))
            if progress("neighbours", made / (N_SMOOTH + priors.n_round + 1)) or not still_open:
                break
    system, inverse, _ = _system(
        replace(now, damping=dr.zeros(Float, dr.width(damping))), freedom, colours, links
    )
    covariance = _covariance(system, inverse, grid, rng, priors.n_draw, progress)
    covariance += squared_pulls(system, now.theta, links)
    found = {scale.prior.name: scale.typical for scale in sorted(now.scales, key=lambda s: s.prior.name)}
    if spectra:
        found["rank"] = spectra.rank
    return Posterior(now.theta, covariance, found, made, still_open)


@dataclass(frozen=True)
class Climb:
    """Where the search stands.

    Attributes
    ----------
    theta : list of Float, (n_unknown)
    data : tuple
        Cost, gradient and matrix of the data there.
    damping : Float, (n_pixel)
    inverse : list of Float
        Lower triangle of the covariance of each pixel's unknowns, neighbours given.
    scales : list of Scale
        How strong priors are.
    """

    theta: list
    data: tuple
    damping: object
    inverse: list
    scales: list


def _system(now: Climb, freedom, colours, links: Links) -> tuple:
    """Give the system of all pixels around a point, its inverse blocks and its right side."""
    learnt = [scale.learnt(type(now.theta[0])) for scale in now.scales]
    forms = joint.weigh(learnt, now.theta, now.inverse, links, freedom)
    _, gradient, matrix = now.data
    if colours:
        gradient, matrix = joint.add_spectra(colours, now.theta, gradient, matrix, now.inverse)
    matrix, lower, pivot, inverse = joint.make_system(forms, matrix, now.damping, links)
    system = joint.JointSystem(matrix, forms, lower, pivot)
    return system, inverse, joint.right_side(forms, now.theta, gradient, links)


def _climb(
    now: Climb, terms_at: Callable, freedom, colours, links: Links, sample, tolerance: float
) -> tuple[Climb, float]:
    """Make a Gauss-Newton step of all pixels together; gives also what the posterior should gain by it."""
    system, inverse, right = _system(now, freedom, colours, links)
    move, trial, gain = _move(now.theta, joint.solve(system, right, links, tolerance), right)
    theta, data, damping = _accept(now.theta, now.data, now.damping, move, trial, terms_at(trial))
    scales = [scale.update(theta, inverse, links, sample) for scale in now.scales]
    return Climb(theta, data, damping, inverse, scales), float(gain[0])


def _chosen(priors: Priors, unknowns: Unknowns) -> list[Prior]:
    all_of_them = smooth_normals(), integrable(), smooth_reflectance(unknowns.n_band)
    return [prior for prior in all_of_them if prior.name in priors.parts]


@recorded
def _move(theta: list, step: list, right: list):
    """Limit a step; gives it, where it leads, and what the posterior should gain by it."""
    trial = Unknowns.moved(theta, [dr.clip(s, -LARGEST_MOVE, LARGEST_MOVE) for s in step])
    move = [new - old for new, old in zip(trial, theta)]
    gain = 0.5 * sum(m * r for m, r in zip(move, right))
    dr.eval(move, trial, gain)
    return move, trial, dr.sum(gain)


def _where_events_agree(now: Climb, first: Climb) -> Climb:
    """Go back where a pixel's own events speak against what its neighbours made of it."""
    worse = now.data[0] - first.data[0] > dr.opaque(type(now.damping), LOST)

    def chosen(value, other):
        if isinstance(value, list | tuple):
            return [chosen(*both) for both in zip(value, other)]
        return dr.select(worse, other, value)

    theta, data, inverse = (chosen(getattr(now, k), getattr(first, k)) for k in ("theta", "data", "inverse"))
    dr.eval(theta, data, inverse)
    return Climb(theta, tuple(data), first.damping, inverse, now.scales)


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
    """How strong a prior is: the covariance of the differences that it wants small, and the least of it.

    Learnt from the clearer half of the differences: others tell little, and what little may be of wrong minima.
    """

    prior: Prior
    spread: np.ndarray
    floor: np.ndarray
    clear: np.ndarray

    @classmethod
    def learn(cls, prior: Prior, theta, inverse, links: Links, sample: np.ndarray) -> "Scale | None":
        """Learn from noisy single pixels; None where there is no difference to learn from."""
        z, noise = differences(prior, theta, inverse, links, sample)
        if not len(z):
            return None
        blur = np.trace(noise, axis1=1, axis2=2)
        clear = blur <= np.median(blur)
        z, noise = z[clear], noise[clear]
        floor = SHARPEST**2 * np.diag(np.median(np.diagonal(noise, axis1=1, axis2=2), axis=0))
        return cls(prior, learn_scatter(z, noise, floor, about_zero=True)[1], floor, clear)

    def update(self, theta, inverse, links: Links, sample: np.ndarray) -> "Scale":
        """Learn from posterior means and covariances."""
        z, left = differences(self.prior, theta, inverse, links, sample)
        spread = update_scatter(z[self.clear], left[self.clear], self.spread, self.floor)
        return replace(self, spread=spread)

    def learnt(self, Float: type) -> Learnt:
        return Learnt.of(self.prior, self.spread, Float)

    @property
    def typical(self) -> float:
        """Root mean square of a component."""
        return float(np.sqrt(np.trace(self.spread) / len(self.spread)))


def differences(prior: Prior, theta: list, inverse: list, links: Links, sample: np.ndarray):
    """Give differences (n, d) at some pixels, and their covariances (n, d, d) if pixels are independent."""
    index = owned(type(links.index["left"]), sample)
    (values, factor, covariance), valid = _differences(prior, theta, inverse, links, index)
    factor = _numpy(factor).astype(float)
    covariance = np.array([[_numpy(c) for c in row] for row in covariance], float)
    z, noise = [], []
    for components, products, there in zip(values, prior.products(), valid):
        some = there.numpy()
        scale = np.broadcast_to(factor, some.shape)[some]
        z.append(scale[:, None] * np.stack([_numpy(c)[some] for c in components], axis=-1))
        own = np.zeros((len(scale), prior.size, prior.size))
        for i, j, k, m, stencil in products:
            own[:, i, j] += sum(stencil.weight.values()) * covariance[k, m][some]
        noise.append(own * scale[:, None, None] ** 2)
    return np.concatenate(z), np.concatenate(noise)


@recorded
def _differences(prior: Prior, theta: list, inverse: list, links: Links, index):
    values = prior.values(prior.quantities(theta), links)
    found = values, prior.factor(theta, links), prior.covariance(theta, inverse)
    return picked(found, index), picked(prior.valid(links), index)


def _numpy(value) -> np.ndarray:
    return np.asarray(value) if isinstance(value, float) else value.numpy()


def _learn_spectra(
    theta: list, inverse: list, unknowns: Unknowns, links: Links, sample: np.ndarray
) -> Spectra | None:
    bands, right = range(2, unknowns.n_map), links.index["right"].numpy()[sample]
    r, noise = _reflectances(theta, inverse, bands, sample)
    beside, noise_beside = _reflectances(theta, inverse, bands, right)
    beside[~(links.exists["right"].numpy()[sample] & is_known(noise_beside))] = np.nan
    return learn_spectra(r, noise, beside)


def _reflectances(
    theta: list, inverse: list, bands: range, some: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Give reflectances of some pixels, and the covariances of their noise."""
    r = np.exp(np.stack([theta[i].numpy()[some] for i in bands], axis=-1).astype(float))
    return r, triangles.block(inverse, bands, some) * r[:, :, None] * r[:, None, :]


# ---------------------------------------------------------------------- how well unknowns are known


def _covariance(system, inverse: list, grid: Grid, rng, n_draw: int, progress) -> np.ndarray:
    """Scale the blocks' inverses (n_pixel, n, n) so that their diagonals are what draws show, pooled.

    Rounding can spoil an inverse: such a pixel tells nothing of its neighbours'.
    """
    single = triangles.block(inverse, range(len(system.pivot)), slice(None))
    variance = np.diagonal(single, axis1=1, axis2=2)
    ratio = np.zeros_like(variance)
    for k in range(n_draw):
        x = joint.solve(system, joint.draw(rng, system, grid.links), grid.links, EXACTLY)
        square = np.square(np.stack([v.numpy() for v in x], axis=-1), dtype=float)
        ratio += np.divide(square, variance, out=np.ones_like(square), where=variance > 0) / n_draw
        progress("draws", (k + 1) / n_draw)
    factor = np.sqrt(_pool(ratio, grid.mask)) if n_draw else np.ones_like(ratio)
    factor[:, :2] = np.sqrt(np.mean(factor[:, :2] ** 2, axis=1, keepdims=True))
    return single * factor[:, :, None] * factor[:, None, :]


def squared_pulls(system: joint.JointSystem, theta: list, links: Links) -> np.ndarray:
    """Give the squares (n_pixel, n, n) of what each prior's pull does to the pixels, summed over the priors.

    Draws take priors for true. But the jump between two surfaces is one, however many pixels see it, and pulls on each of
    them; where single pixels hardly know their scale that adds up over a whole surface, and does not average out. Of
    a true prior of the precision p, beside data of h, the mean square is p h / (h + p)^3: a quarter of the variance at most.
    """
    out, width = 0.0, dr.width(theta[0])

    def zeros(n: int) -> list:
        values = [dr.zeros(type(theta[0]), width) for _ in range(n)]
        dr.make_opaque(values)
        return values

    for form in system.forms:
        # the others stay with no weight: functions are recorded for the forms that they get
        alone = [f if f is form else replace(f, weights=zeros(len(f.weights))) for f in system.forms]
        pull = joint.right_side(alone, theta, zeros(len(theta)), links)
        step = np.stack([v.numpy() for v in joint.solve(system, pull, links, EXACTLY)], axis=-1).astype(float)
        out = out + step[:, :, None] * step[:, None, :]
    return out


def _pool(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Average (n_pixel, n) over windows of the image."""
    weight = ndimage.uniform_filter(mask.astype(float), POOL)[mask]
    out = np.empty_like(values)
    for i, column in enumerate(values.T):
        image = np.zeros(mask.shape)
        image[mask] = column
        out[:, i] = ndimage.uniform_filter(image, POOL)[mask] / weight
    return out
