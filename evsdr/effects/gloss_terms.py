"""What a lobe of gloss does to the event pairs of some pixels: residuals, derivatives by strength and shape.

In NumPy, since a few hundred pixels tell all there is to know of a lobe.
"""

import drjit as dr
import numpy as np

from evsdr.model.arrays import columns, owned
from evsdr.model.gloss import GlossyRing
from evsdr.model.lambert import LambertianRing
from evsdr.solve.loss import SMALLEST_SLOPE, gaussian_share
from evsdr.solve.unknowns import LOG_REFLECTANCE_SIGMA, REFLECTANCE_CENTRE, SLOPE_SIGMA

N_SAMPLE, MAX_PAIRS = 400, 256  # pixels that stand for all of a kind, and pairs of each
ROBUST = 3.0  # width of the Cauchy cost in standard deviations
SLOPE_TERM = gaussian_share(ROBUST)
STEP = 0.01  # of finite differences by the logarithm of a shape


class Sample:
    """The event pairs of some pixels as padded NumPy arrays, and their derivatives by unknowns and lobe.

    Parameters
    ----------
    candidate : (n_pixel,) bool
        Pixels to choose from; those without pairs are left out.

    Others as those of `gloss_evidence`.
    """

    def __init__(self, problem, candidate: np.ndarray, noise: float, view=None):
        pairs = problem.pairs
        offset = pairs.offset.numpy().astype(np.int64)
        count = np.diff(offset)
        candidate = np.flatnonzero(candidate & (count > 0))
        self.pixel = candidate[:: max(1, -(-len(candidate) // N_SAMPLE))]
        if len(self.pixel) == 0:
            return
        index = owned(type(pairs.offset), self.pixel)
        self.illumination = problem.illumination.gather(index)
        self.view = view if view is None or dr.width(view) == 1 else dr.gather(type(view), view, index)
        self.constant_light = float(problem.illumination.constant_light[0])
        self.band = np.append(problem.illumination.band, 0)
        self.noise = noise

        count = count[self.pixel]
        width = min(int(count.max()), MAX_PAIRS)
        stride = np.maximum(count, width) / width
        place = (np.arange(width) * stride[:, None]).astype(np.int64)
        self.valid = place < count[:, None]
        start, coded = np.moveaxis(
            pairs.phases.numpy().reshape(-1, 2)[offset[self.pixel, None] + place * self.valid], -1, 0
        )
        on, off = (t.numpy()[self.pixel, None] for t in (pairs.threshold_on, pairs.threshold_off))
        self.polarity = np.sign(coded)
        self.threshold = np.where(coded > 0, on, off)
        slot_leds = pairs.slot_leds.numpy()
        self.fading = self.valid & (np.abs(coded) % 1.0 > 0)
        self.lit = []
        for phase in (start, np.abs(coded) - 1.0):
            slot = phase.astype(np.int64)
            leds, fade = slot_leds[slot], phase - slot
            self.lit.append([(leds & 0xFFFF, 1.0 - fade), (leds >> 16, fade)])

    def tables(self, theta: np.ndarray, kind: type, shape: float) -> np.ndarray:
        """Evaluate the model: (7, n_led + 1, n_pixel).

        Diffuse signal and its derivatives by the slopes; the same three of a lobe of strength 1; and the
        derivative of that lobe by the logarithm of its shape.
        """
        light = self.illumination
        Float = type(light.irradiance[0])
        p, q, *rho = columns(Float, theta)
        rho = [dr.exp(r) for r in rho]
        soft, one = dr.opaque(Float, light.horizon), dr.opaque(Float, 1.0)
        models = [LambertianRing(light)]
        for factor in (1.0, np.exp(-STEP), np.exp(STEP)):
            models.append(GlossyRing(light, kind(dr.opaque(Float, shape * float(factor)), one), self.view))
        rows = [model(p, q, rho, soft) for model in models]
        arrays = [list(rows[0]), list(rows[1][:3]), [rows[2][0]], [rows[3][0]]]
        dr.eval(arrays)
        matt, glossy, less, more = (
            np.array([[np.broadcast_to(v.numpy(), len(theta)) for v in leds] for leds in part], float)
            for part in arrays
        )
        by_shape = (more - less) / (2 * STEP)
        table = np.concatenate([matt, glossy - matt, by_shape])
        return np.concatenate([table, np.zeros((7, 1, len(theta)))], axis=1)

    def terms(self, theta: np.ndarray, kind: type, shape: float, strength: float):
        """Residuals and derivatives of all pairs.

        Returns
        -------
        cost : float
            Robust, prior included.
        normal : (n_pixel, n + 2, n + 2) float
            Weighted squares of the derivatives by n unknowns of the pixel, strength, and log shape.
        gradient : (n_pixel, n + 2) float
        """
        n = theta.shape[1]
        table = self.tables(theta, kind, shape)
        row, column = np.indices(self.valid.shape)

        def derivative(leds_and_weights):
            """Derivatives of a weighted sum of signals by all unknowns."""
            out = np.zeros((*self.valid.shape, n + 2))
            for led, weight in leds_and_weights:
                value = weight * table[:, led, row]
                out[..., :2] += np.moveaxis(value[1:3] + strength * value[4:6], 0, -1)
                out[row, column, 2 + self.band[led]] += value[0]
                out[..., -2] += value[3]
                out[..., -1] += strength * value[6]
            return out

        signal = table[0] + strength * table[3]
        total = [
            self.constant_light + sum(share * signal[led, row] for led, share in lit) for lit in self.lit
        ]
        by_start, by_end = (
            derivative((led, share / whole) for led, share in lit) for lit, whole in zip(self.lit, total)
        )
        # the residual of each pair, as in event_terms
        scale = self.valid * self.polarity / (self.threshold * self.noise)
        residual = np.log(total[1] / total[0]) * scale - self.valid / self.noise
        jacobian = (by_end - by_start) * scale[..., None]
        excess = (residual / ROBUST) ** 2
        weighted = jacobian / (1.0 + excess)[..., None]
        # the density of event times
        (before, _), (after, _) = self.lit[1]
        gain = self.fading * self.polarity / total[1]
        speed = gain * (signal[after, row] - signal[before, row])
        root = np.sqrt(speed**2 + SMALLEST_SLOPE**2)
        by_speed = derivative(((before, -gain), (after, gain))) - speed[..., None] * by_end
        by_speed /= -root[..., None]
        # weak priors
        sigma = np.where(np.arange(n) < 2, SLOPE_SIGMA, LOG_REFLECTANCE_SIGMA)
        z = (theta - np.where(np.arange(n) < 2, 0.0, np.log(REFLECTANCE_CENTRE))) / sigma

        density = self.fading * np.log(0.5 * (speed + root))
        cost = 0.5 * ROBUST**2 * np.log1p(excess).sum() - SLOPE_TERM * density.sum() + 0.5 * np.sum(z**2)
        normal = np.swapaxes(weighted, 1, 2) @ jacobian
        normal += SLOPE_TERM * np.swapaxes(by_speed, 1, 2) @ by_speed
        gradient = np.einsum("xki,xk->xi", weighted, residual) + SLOPE_TERM * by_speed.sum(axis=1)
        diagonal = np.arange(n)
        normal[:, diagonal, diagonal] += sigma**-2.0
        gradient[:, :n] += z / sigma
        return cost, normal, gradient


def eliminate(normal: np.ndarray, gradient: np.ndarray, n_shared: int):
    """Eliminate the unknowns of each pixel by the Schur complement.

    Returns
    -------
    matrix : (n_pixel, n_shared, n_shared) float
    score : (n_pixel, n_shared) float
        What remains of matrix and gradient of the shared unknowns.
    own : (n_pixel, n) float
        Step of the pixel's unknowns if the shared ones stay.
    coupled : (n_pixel, n, n_shared) float
        What to subtract from it per step of the shared ones.
    """
    n = normal.shape[1] - n_shared
    right = np.concatenate([gradient[:, :n, None], normal[:, :n, n:]], axis=-1)
    solved = np.linalg.solve(normal[:, :n, :n], right)
    own, coupled = -solved[..., 0], solved[..., 1:]
    cross = np.swapaxes(normal[:, :n, n:], 1, 2)
    return (
        normal[:, n:, n:] - cross @ coupled,
        gradient[:, n:] + (cross @ own[..., None])[..., 0],
        own,
        coupled,
    )
