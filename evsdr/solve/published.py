"""The decoder of EventSpecPS (its section 5.1), for comparison.

Normals and a reflectance of rank K, R_xb = sum_k a_xk b_kb, fitted to event pairs by AdamW. The derivative
is Dr.Jit's, through the signals of the ring integrator. The paper leaves open the exact form of gate and
consistency; here a pair counts less where the normal is within `GATE_DEG` of the half vector of an LED, and
normals and coefficients are pulled toward their own Gaussian blur.
"""

from dataclasses import dataclass

import drjit as dr
import numpy as np
from drjit.opt import AdamW

from evsdr.frozen import no_garbage_collection
from evsdr.model.arrays import owned
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import led_signals
from evsdr.progress import Progress, silent
from evsdr.solve.loss import relative_residual
from evsdr.solve.noise import MEDIAN_TO_SIGMA
from evsdr.solve.pair_data import PairData, ends, every_pair, signal_table

GATE_DEG = 11.88  # half-peak width of a Blinn-Phong lobe of shininess 32 (supplement, eq. 11)
SMALLEST_NZ = 0.02
NORMAL = ("nx", "ny", "nz")  # names of its components
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


@dataclass(frozen=True)
class DecoderLoss:
    """What the loss is made of.

    Attributes
    ----------
    illumination : Illumination
    pairs : PairData
    pair, pixel : UInt32, (n_pair)
        Number of each pair, and its pixel.
    half : list of Array3f
        Half vectors of the LEDs and the camera's axis.
    per_pixel : Float
        1 / n_pixel.
    settings : AdamSettings
    """

    illumination: Illumination
    pairs: PairData
    pair: object
    pixel: object
    half: list
    per_pixel: object
    settings: AdamSettings

    @classmethod
    def of(cls, illumination: Illumination, pairs: PairData, settings: AdamSettings) -> "DecoderLoss":
        """Collect it."""
        Float, Array3f = type(pairs.phases), type(illumination.direction[0])
        pair, pixel = every_pair(pairs)
        dr.make_opaque(pair, pixel)
        half = [dr.normalize(d + Array3f(0, 0, 1)) for d in illumination.direction]
        per_pixel = dr.opaque(Float, 1 / dr.width(pairs.threshold_on))
        return cls(illumination, pairs, pair, pixel, half, per_pixel, settings)

    @property
    def maps(self) -> list[str]:
        """Names of the unknowns of each pixel: normal and coefficients."""
        return [*NORMAL, *(f"a{k}" for k in range(self.settings.rank))]

    def reflectance(self, unknowns: dict) -> list:
        """Give the reflectance of each band."""
        Float, UInt32 = type(self.pairs.phases), type(self.pairs.first)
        return [
            sum(
                unknowns[f"a{k}"] * dr.gather(Float, unknowns[f"b{k}"], UInt32(b))
                for k in range(self.settings.rank)
            )
            for b in range(self.illumination.n_band)
        ]

    def residuals(self, unknowns: dict):
        """Give the normals, and residual and threshold of each pair."""
        normal = dr.normalize(type(self.half[0])(*(unknowns[name] for name in NORMAL)))
        signal = led_signals(self.illumination, normal, self.reflectance(unknowns))
        table = signal_table(signal, dr.width(normal))
        given = self.pairs, self.illumination.constant_light, self.pair, self.pixel
        return normal, *relative_residual(table, *given, True)

    def gate(self, normal):
        """Give the weight of each pair: low where the normal is near the half vector of one of its LEDs."""
        angle = [dr.acos(dr.minimum(dr.dot(normal, h), 1.0)) for h in self.half]
        depth, width = 1.0 - self.settings.gate_floor, float(np.radians(GATE_DEG))
        gloss = [depth * dr.exp(-dr.square(x / width)) for x in angle]
        table = signal_table(gloss, dr.width(normal))
        start, end, _ = ends(table, self.pairs, self.pair, self.pixel, True)
        return (1.0 - start) * (1.0 - end)


@no_garbage_collection()
def solve(
    illumination: Illumination,
    pairs: PairData,
    start_normal: np.ndarray,
    pixel: np.ndarray,
    shape: tuple[int, int],
    settings: AdamSettings = AdamSettings(),
    seed: int = 0,
    progress: Progress = silent,
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
    Float = type(pairs.phases)
    decoder = DecoderLoss.of(illumination, pairs, settings)
    optimiser = first_unknowns(decoder, start_normal, seed)
    place, step = owned(type(pairs.first), pixel), dr.freeze(_step)
    width = dr.opaque(Float, 0.0)  # of what is down-weighted, inverse; 0 weighs nothing down
    for i in range(settings.n_step):
        if settings.robust and i == settings.n_step // 2:
            residual = decoder.residuals(dict(optimiser.items()))[1].numpy()
            scatter = MEDIAN_TO_SIGMA * float(np.median(np.abs(residual)))
            width = dr.opaque(Float, 1 / (settings.robust * scatter))
        maps = [dr.detach(optimiser[name]) for name in decoder.maps]
        step(optimiser, decoder, blur(maps, place, shape, settings), width)
        dr.eval(optimiser)
        dr.sync_thread()
        if progress("AdamW", (i + 1) / settings.n_step):
            break
    normal = np.stack([optimiser[name].numpy() for name in NORMAL], axis=-1)
    reflectance = np.stack([r.numpy() for r in decoder.reflectance(optimiser)], axis=-1)
    return normal, reflectance


def first_unknowns(decoder: DecoderLoss, normal: np.ndarray, seed: int) -> AdamW:
    """Give an optimiser with the unknowns to start from: normals (n_pixel, 3), near-equal coefficients and bases."""
    settings, rng = decoder.settings, np.random.default_rng(seed)
    Float, n_band = type(decoder.per_pixel), decoder.illumination.n_band
    beta_1, beta_2 = settings.beta
    optimiser = AdamW(settings.rate_reflectance, beta_1=beta_1, beta_2=beta_2, weight_decay=WEIGHT_DECAY)
    for name, column in zip(NORMAL, normal.T):
        optimiser[name] = owned(Float, column)
    for k in range(settings.rank):
        optimiser[f"a{k}"] = owned(Float, 0.2 + 0.01 * rng.standard_normal(len(normal)))
        optimiser[f"b{k}"] = owned(Float, n_band**-0.5 * (1 + 0.1 * rng.standard_normal(n_band)))
    optimiser.set_learning_rate(dict.fromkeys(NORMAL, settings.rate_normal))
    return optimiser


def _step(optimiser: AdamW, decoder: DecoderLoss, smooth: list, width) -> None:
    """Make one step down the loss, in place."""
    unknowns, settings = dict(optimiser.items()), decoder.settings
    normal, u, threshold = decoder.residuals(unknowns)
    trust = dr.rcp(1.0 + dr.square(dr.detach(u) * width))
    weight = decoder.gate(dr.detach(normal)) * trust / dr.sum(trust)  # the blur counts as before
    loss = dr.sum(weight * dr.square(threshold * u))
    for name, target in zip(decoder.maps, smooth):
        loss += settings.consistency * dr.sum(dr.square(unknowns[name] - target)) * decoder.per_pixel
    dr.backward(loss)
    optimiser.step()
    constrain(optimiser, settings.rank)


def constrain(optimiser, rank: int) -> None:
    """Project in place on n_z > 0, unit normals, reflectance >= 0 and unit bases."""
    x, y, z = (dr.detach(optimiser[name]) for name in NORMAL)
    z = dr.maximum(z, SMALLEST_NZ)
    inverse = dr.rsqrt(x * x + y * y + z * z)
    for name, component in zip(NORMAL, (x, y, z)):
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
