"""What light each LED gives a pixel by the pixel's own events, beside what the maps say.

With x_j what is added to log (A_j + C_w) of LED j, and one more for darkness, log I changes to first order by the mean
of x over what is lit, weighted by its share of I. Each pair of events measures a difference of two such means; x is
their weighted least squares solution. Differences leave the mean of x open: a weak prior sets it to 0. What light that is
followed faster would add to that of photoreceptors that lag is left out of x.
"""

import drjit as dr
import numpy as np
from numba import njit

from evsdr.frozen import no_garbage_collection
from evsdr.records import Signals
from evsdr.solve.loop import resume
from evsdr.solve.pair_data import PairData
from evsdr.solve.solution import Data, Solution
from evsdr.solve.stages import softness_at
from evsdr.threads import N_CHUNK, in_chunks

PRIOR = 1.0  # precision of x: what no event tells has a standard deviation of 1, a factor of e


def measure_signals(data: Data, solution: Solution, pixel: np.ndarray, most: int | None = None) -> Signals:
    """Ask the events of each pixel what each LED gives it.

    Parameters
    ----------
    data : Data
        What was solved.
    solution : Solution
        Where light is known nearly.
    pixel : (n_pixel,) int
        Where the pixels lie in the image.
    most : int, optional
        Pixels that are asked: those in the middle.
    """
    light = data.model.illumination
    constant_light = float(data.constant_light[0])
    total = light_of(data, solution)
    n_pixel, n_light = total.shape
    asked = n_pixel if most is None else min(most, n_pixel)
    part = slice((n_pixel - asked) // 2, (n_pixel + asked) // 2)
    change, sigma = np.zeros((2, n_pixel, n_light), np.float32)
    residual = np.zeros(n_pixel, np.float32)
    pairs, slot_leds, thresholds = _told(data.pairs, solution)
    noise = solution.noise * solution.noise_factor.astype(np.float64)
    bound = np.linspace(part.start, part.stop, N_CHUNK + 1).astype(np.int64)
    given = pairs, slot_leds, thresholds, total, noise, float(data.robust)

    def work(chunk):
        _solve_pixels(*given, bound[chunk], bound[chunk + 1], change, sigma, residual)

    in_chunks(work)
    direction = np.array([[np.mean(c.numpy()) for c in d] for d in light.direction], float)
    return Signals(
        pixel=pixel[part],
        modelled=total[part, :-1].astype(np.float32),
        change=change[part, :-1],
        sigma=sigma[part, :-1],
        residual=residual[part],
        count=pairs[1][part],
        band=np.array(light.band),
        direction=direction / np.linalg.norm(direction, axis=1, keepdims=True),
        constant_light=constant_light,
    )


@no_garbage_collection()
def light_of(data: Data, solution: Solution) -> np.ndarray:
    """Give A_xj + C_w (n_pixel, n_led + 1) of a solution; the last column is darkness."""
    state = resume(data, solution)
    unknowns = data.unknowns(state.theta)
    hard = dr.opaque(type(data.constant_light), data.model.illumination.horizon)
    softness = softness_at(data, state.theta) if solution.curved else hard
    signal = data.model(state.theta[0], state.theta[1], unknowns.reflectance(state.theta), softness)[0]
    dr.eval(signal)
    n_pixel = len(solution.theta)
    columns = [np.broadcast_to(s.numpy(), n_pixel) for s in signal] + [np.zeros(n_pixel)]
    return np.stack(columns, axis=1).astype(np.float64) + float(data.constant_light[0])


def _told(pairs: PairData, solution: Solution) -> tuple:
    """Give what events tell as NumPy's arrays: pairs (where they begin, count, phases, biases, answers), LEDs of each slot, thresholds (2, n_pixel)."""
    begin, count, phases = pairs.first.numpy().astype(np.int64), pairs.counts, pairs.phases.numpy()
    bias = np.zeros(len(phases) // 2, np.float32) if pairs.bias is None else pairs.bias.numpy()
    answer = np.ones_like(phases) if pairs.answer is None else pairs.answer.numpy()
    n_pixel = len(begin)
    given = (pairs.threshold_on, pairs.threshold_off)
    thresholds = np.stack([np.broadcast_to(t.numpy(), n_pixel) for t in given]).astype(np.float64)
    if solution.threshold_gain is not None:
        thresholds *= solution.threshold_gain.T
    return (begin, count, phases, bias, answer), pairs.slot_leds.numpy().astype(np.int64), thresholds


@njit(cache=True, nogil=True)
def _solve_pixels(pairs, slot_leds, thresholds, total, noise, robust, first, last, change, sigma, residual):
    """Fill x, its standard deviation, and the scatter of residuals of pixels first .. last - 1."""
    begin, count, phases, bias, answer = pairs
    n = total.shape[1]
    at, share = np.empty(4, np.int64), np.empty(4)
    matrix, pull, told = np.empty((n, n)), np.empty(n), np.empty(n, np.bool_)
    for i in range(first, last):
        matrix[:], pull[:] = 0.0, 0.0
        for j in range(n):
            matrix[j, j] = PRIOR
        square, all_weights = 0.0, 0.0
        for k in range(begin[i], begin[i] + count[i]):
            logs = bias[k]
            for side in range(2):
                phase = np.float64(phases[2 * k]) if side == 0 else abs(np.float64(phases[2 * k + 1])) - 1
                slot = np.int64(phase)
                fade, sign = phase - slot, 2 * side - 1
                one, other = slot_leds[slot] & 0xFFFF, slot_leds[slot] >> 16
                lit = (1 - fade) * total[i, one] + fade * total[i, other]
                at[2 * side], at[2 * side + 1] = one, other
                share[2 * side] = sign * (1 - fade) * total[i, one] / lit
                share[2 * side + 1] = sign * fade * total[i, other] / lit
                logs += sign * answer[2 * k + side] * np.log(lit)
            polarity = 1.0 if phases[2 * k + 1] > 0 else -1.0
            threshold = thresholds[0, i] if polarity > 0 else thresholds[1, i]
            unexplained, scale = polarity * threshold - logs, threshold * noise[i]
            weight = 1 / (1 + (unexplained / (scale * robust)) ** 2)
            square += weight * (unexplained / threshold) ** 2
            all_weights += weight
            weight /= scale**2
            for a in range(4):
                pull[at[a]] += weight * share[a] * unexplained
                for b in range(4):
                    matrix[at[a], at[b]] += weight * share[a] * share[b]
        residual[i] = np.sqrt(square / max(all_weights, 1e-12))
        n_told = 0
        for j in range(n):
            told[j] = matrix[j, j] > PRIOR
            n_told += told[j]
        _invert(matrix)
        for j in range(n):
            x = 0.0
            for k in range(n):
                x += matrix[j, k] * pull[k]
            change[i, j] = x
            # The mean of what events tell of is chosen, not measured: it has 1 / (n_told PRIOR) of the variance
            chosen = 1 / (n_told * PRIOR) if told[j] else 0.0
            sigma[i, j] = np.sqrt(max(matrix[j, j] - chosen, 0))


@njit(cache=True, nogil=True)
def _invert(matrix):
    """Invert a symmetric positive definite matrix in place, by Gauss and Jordan: it needs no pivots."""
    n = len(matrix)
    for k in range(n):
        pivot = 1 / matrix[k, k]
        matrix[k, k] = 1
        for j in range(n):
            matrix[k, j] *= pivot
        for i in range(n):
            factor = matrix[i, k]
            if i == k or factor == 0:
                continue
            matrix[i, k] = 0
            for j in range(n):
                matrix[i, j] -= factor * matrix[k, j]
