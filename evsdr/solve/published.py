"""The decoder of EventSpecPS (its section 5.1), for comparison.

Normals and a reflectance of rank K, R_xb = sum_k a_xk b_kb, fitted to event pairs by AdamW. The derivative
is Dr.Jit's, through the signals of the ring integrator. The paper leaves open the exact form of gate and
consistency; here a pair counts less where the normal is within `GATE_DEG` of the half vector of an LED, and
normals and coefficients are pulled toward their own Gaussian blur.
"""

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import numpy as np
from drjit.opt import AdamW

from evsdr.frozen import no_garbage_collection
from evsdr.model.arrays import owned
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import led_signals
from evsdr.solve.loss import relative_residual
from evsdr.solve.noise import MEDIAN_TO_SIGMA
from evsdr.solve.pair_data import PairData, ends, signal_table

GATE_DEG = 11.88  # half-peak width of a Blinn-Phong lobe of shininess 32 (supplement, eq. 11)
SMALLEST_NZ = 0.02
WEIGHT_DECAY = 0.01  # AdamW's usual value; the paper names none


@dataclass(frozen=True)
class AdamSettings:
    """Settings of the paper, section 5.1; `consistency` and `gate_floor` are ours.

    Attributes
    ----------
    rank : int
        K, number of spectral bases.
    n_step : int
        Iterations.
    rate_normal, rate_reflectance : float
        Learning rates.
    beta : (float, float)
        Decay of the moments.
    blur_size, blur_sigma : int, float
        Kernel of the consistency term [pixels].
    consistency : float
        Its weight.
    gate_floor : float
        Weight of a pair on the half vector itself.
    robust : float, optional
        Width of the Cauchy cost in standard deviations, which down-weights pairs that contradict the model, as those
        in cast shadows do; by default all count alike.
    """

    rank: int = 8
    n_step: int = 1600
    rate_normal: float = 1e-2
    rate_reflectance: float = 3e-2
    beta: tuple[float, float] = (0.5, 0.95)
    blur_size: int = 21
    blur_sigma: float = 5.0
    consistency: float = 1e-2
    gate_floor: float = 0.1
    robust: float | None = None


@no_garbage_collection()
def solve(
    illumination: Illumination,
    pairs: PairData,
    start_normal: np.ndarray,
    pixel: np.ndarray,
    shape: tuple[int, int],
    settings: AdamSettings = AdamSettings(),
    seed: int = 0,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> tuple[np.ndarray, np.ndarray]:
    """Fit normals and low-rank reflectance to event pairs by AdamW.

    Parameters
    ----------
    illumination : Illumination
        What the LEDs send to the pixels.
    pairs : PairData
        Their event pairs.
    start_normal : (n_pixel, 3) float
        Start values, camera frame.
    pixel : (n_pixel,) int
        Where the pixels lie in the image, row-major.
    shape : (int, int)
        Height and width of the image.
    seed : int
        Of the perturbation of the start.

    Returns
    -------
    normal : (n_pixel, 3) float32
    reflectance : (n_pixel, n_band) float32
    """
    Float, UInt32 = type(pairs.phases), type(pairs.offset)
    Array3f = type(illumination.direction[0])
    rng = np.random.default_rng(seed)
    n_pixel, n_band, rank = len(pixel), illumination.n_band, settings.rank
    pair = dr.arange(UInt32, dr.width(pairs.phases) // 2)
    pixel_of_pair = owned(UInt32, np.repeat(np.arange(n_pixel), pairs.counts))
    dr.make_opaque(pair, pixel_of_pair)
    per_pixel = dr.opaque(Float, 1 / n_pixel)
    half = [dr.normalize(d + Array3f(0, 0, 1)) for d in illumination.direction]
    place = owned(UInt32, pixel)

    maps = ["nx", "ny", "nz", *(f"a{k}" for k in range(rank))]
    optimiser = AdamW(
        settings.rate_reflectance, beta_1=settings.beta[0], beta_2=settings.beta[1], weight_decay=WEIGHT_DECAY
    )
    for name, column in zip(maps, start_normal.T):
        optimiser[name] = owned(Float, column)
    for k in range(rank):
        optimiser[f"a{k}"] = Float((0.2 + 0.01 * rng.standard_normal(n_pixel)).astype(np.float32))
        optimiser[f"b{k}"] = Float(
            (n_band**-0.5 * (1 + 0.1 * rng.standard_normal(n_band))).astype(np.float32)
        )
    optimiser.set_learning_rate(nx=settings.rate_normal, ny=settings.rate_normal, nz=settings.rate_normal)

    def reflectance_of(variables):
        return [
            sum(variables[f"a{k}"] * dr.gather(Float, variables[f"b{k}"], UInt32(b)) for k in range(rank))
            for b in range(n_band)
        ]

    def gate(normal):
        """Weight of each pair: low where the normal is near the half vector of one of its LEDs."""
        angle = [dr.acos(dr.minimum(dr.dot(normal, h), 1.0)) for h in half]
        gloss = [
            (1.0 - settings.gate_floor) * dr.exp(-dr.square(x / float(np.radians(GATE_DEG)))) for x in angle
        ]
        start, end, _ = ends(signal_table(gloss, n_pixel), pairs, pair, pixel_of_pair, True)
        return (1.0 - start) * (1.0 - end)

    def residuals():
        return residuals_at(dict(optimiser.items()))[1]

    def residuals_at(variables):
        normal = dr.normalize(Array3f(*(variables[name] for name in maps[:3])))
        table = signal_table(led_signals(illumination, normal, reflectance_of(variables)), n_pixel)
        return normal, *relative_residual(
            table, pairs, illumination.constant_light, pair, pixel_of_pair, True
        )

    @dr.freeze(state_fn=lambda *_: (illumination, pairs, pair, pixel_of_pair, half, per_pixel))
    def step(optimiser, smooth, width):
        variables = dict(optimiser.items())
        normal, u, threshold = residuals_at(variables)
        trust = dr.rcp(1.0 + dr.square(dr.detach(u) * width))
        weight = gate(dr.detach(normal)) * trust / dr.sum(trust)  # the blur counts as before
        loss = dr.sum(weight * dr.square(threshold * u))
        for name, target in zip(maps, smooth):
            loss += settings.consistency * dr.sum(dr.square(variables[name] - target)) * per_pixel
        dr.backward(loss)
        optimiser.step()
        constrain(optimiser, rank)

    width = dr.opaque(Float, 0.0)  # of what is down-weighted, inverse; 0 weighs nothing down
    for i in range(settings.n_step):
        if settings.robust and i == settings.n_step // 2:
            scatter = MEDIAN_TO_SIGMA * float(np.median(np.abs(residuals().numpy())))
            width = dr.opaque(Float, 1 / (settings.robust * scatter))
        step(optimiser, blur([dr.detach(optimiser[name]) for name in maps], place, shape, settings), width)
        dr.eval(optimiser)
        dr.sync_thread()
        progress("AdamW", (i + 1) / settings.n_step)
    normal = np.stack([optimiser[name].numpy() for name in maps[:3]], axis=-1)
    reflectance = np.stack([r.numpy() for r in reflectance_of(optimiser)], axis=-1)
    return normal, reflectance


def constrain(optimiser, rank: int) -> None:
    """Project in place on n_z > 0, unit normals, reflectance >= 0 and unit bases."""
    x, y, z = (dr.detach(optimiser[name]) for name in ("nx", "ny", "nz"))
    z = dr.maximum(z, SMALLEST_NZ)
    inverse = dr.rsqrt(x * x + y * y + z * z)
    for name, component in zip(("nx", "ny", "nz"), (x, y, z)):
        optimiser[name] = component * inverse
    for k in range(rank):
        basis = dr.maximum(dr.detach(optimiser[f"b{k}"]), 1e-6)
        length = dr.sqrt(dr.sum(dr.square(basis)))
        optimiser[f"b{k}"] = basis / length
        optimiser[f"a{k}"] = dr.maximum(dr.detach(optimiser[f"a{k}"]), 0.0) * length


def blur(maps: list, pixel, shape: tuple[int, int], settings: AdamSettings) -> list:
    """Blur maps of the solved pixels by a Gaussian; what lies outside has no weight."""
    Float = type(maps[0])
    offsets = np.arange(settings.blur_size) - settings.blur_size // 2
    kernel = np.exp(-0.5 * (offsets / settings.blur_sigma) ** 2).tolist()
    layers = [dr.full(Float, 1.0, dr.width(maps[0])), *maps]
    size = shape[0] * shape[1]
    image = dr.zeros(Float, len(layers) * size)
    for i, values in enumerate(layers):
        dr.scatter(image, values, pixel + i * size, mode=dr.ReduceMode.NoConflicts)
    image = dr.convolve(dr.tensor_t(Float)(image, (len(layers), *shape)), kernel, axis=(1, 2)).array
    weight, *sums = (dr.gather(Float, image, pixel + i * size) for i in range(len(layers)))
    return [total / weight for total in sums]
