"""Finding metal in event pairs: are the pixels of metal rather than matt, and how rough is it.

Metal that is taken for matt gives wrong normals everywhere. So some pixels are solved from nothing as either, metal from rough to
smooth, as narrow lobes leave most starts without a slope. Events that are held back say which it is.
"""

from dataclasses import dataclass

import drjit as dr
import numpy as np

from evsdr.effects.sample import Sample, gained
from evsdr.model.metal import MetalRing
from evsdr.solve.noise import IGNORED
from evsdr.solve.problem import Problem
from evsdr.solve.solution import Solution
from evsdr.solve.unknowns import REFLECTANCE_CENTRE

N_SAMPLE = 160  # pixels that stand for all
FEWEST = 20  # that can tell
NOISE = 0.1  # of the relative residual, about what is left where a model is right
ROUGH, SMOOTH = (0.6, 0.42, 0.3, 0.21), (0.15, 0.1, 0.07)  # that are tried, one after another
FACTOR, RANGE = 1.6, (0.02, 1.0)  # of the search from there, and of roughness
SOFTNESSES = 0.3, 0.1, 0.03, None  # of a matt surface's horizon
# Standard deviations, and log likelihood of a pixel, that metal must gain; measured: copper 6 to 8 and 1.4 to 1.9, matt
# and coated spheres, bumpy meshes and sculptures -7 and less
LEAST_Z, LEAST_GAIN = 4.0, 0.7
MOST_NOISE = 0.12  # of its residuals: more contradicts it as well, see `doubts.NOISY`


@dataclass(frozen=True)
class MetalEvidence:
    """What events that are held back say of metal.

    Attributes
    ----------
    roughness : float
        Under which the other events are likeliest.
    z, gain : float
        What metal of it gains over a matt surface, see `sample.gained`.
    noise : float
        Scatter of the residuals that it leaves.
    """

    roughness: float = ROUGH[0]
    z: float = 0.0
    gain: float = 0.0
    noise: float = 0.0

    @property
    def is_clear(self) -> bool:
        """Whether it is metal."""
        return self.z > LEAST_Z and self.gain > LEAST_GAIN and self.noise < MOST_NOISE


def metal_evidence(problem: Problem, thresholds: bool) -> MetalEvidence:
    """Ask the events for metal; each pixel's thresholds may be unknown."""
    n_unknown = 2 + problem.illumination.n_band + 2 * thresholds
    pixel = spread_over(np.flatnonzero(problem.pairs.counts > n_unknown))
    if len(pixel) < FEWEST:
        return MetalEvidence()
    sample = Sample.of(problem, pixel, NOISE)
    theta = np.zeros((len(pixel), n_unknown))
    theta[:, 2 : 2 + problem.illumination.n_band] = np.log(REFLECTANCE_CENTRE)
    matt = theta
    for softness in SOFTNESSES:
        _, matt_held, matt = sample.hold_back(matt, sample.data.model, softness)
    best, least = MetalEvidence(), np.inf
    for roughness in (*ROUGH, *SMOOTH):
        if roughness == SMOOTH[0] and best.z < 0:
            break
        model = metal_of(sample, roughness)
        cost, held, theta = sample.hold_back(theta, model)
        if np.median(cost) < least:
            least = np.median(cost)
            best = MetalEvidence(roughness, *gained(matt_held, held), sample.scatter(theta, model))
    return best


def spread_over(pixel: np.ndarray) -> np.ndarray:
    """Choose at most `N_SAMPLE` pixels, evenly."""
    return pixel[:: max(1, -(-len(pixel) // N_SAMPLE))]


def metal_of(sample: Sample, roughness: float) -> MetalRing:
    """Give the forward model of a sample of metal."""
    alpha = dr.opaque(type(sample.data.constant_light), roughness)
    return MetalRing(sample.illumination, alpha, sample.view)


def refine_roughness(problem: Problem, solution: Solution) -> float:
    """Find the roughness of smallest cost near that of a fit, with the unknowns of some pixels free."""
    from scipy.optimize import minimize_scalar  # late: few scenes are of metal

    n_unknown = solution.all_theta.shape[1]
    good = (problem.pairs.counts > n_unknown) & (solution.noise_factor < IGNORED)
    pixel, roughness = spread_over(np.flatnonzero(good)), float(problem.metal[0])
    if len(pixel) < FEWEST:
        return roughness
    sample = Sample.of(problem, pixel, solution.noise, solution.threshold_prior)
    theta = solution.all_theta[pixel]

    def cost(log_roughness):
        return np.sum(sample.solve(theta, metal_of(sample, np.exp(log_roughness)))[0])

    bounds = np.log(np.clip(roughness * np.array([1 / FACTOR, FACTOR]), *RANGE))
    return float(np.exp(minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 0.01}).x))
