"""Likelihood of the events of watched pixels, by the unknowns of a model and those of the sensor.

It is that of a fit (`solve.shared.kernel`): first passages behind photoreceptors that lag and are noisy. Each pixel's
information by the logarithms of the LEDs' signals is summed, and led back to the unknowns by the chain rule.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from evsdr.calibration.watched import Watched
from evsdr.events.lead import TABLE
from evsdr.solve.law import variance_of
from evsdr.solve.noise import NOISE_RANGE
from evsdr.solve.shared.kernel import ON, Terms, pixel_sums
from evsdr.solve.shared.pixels import stirred_values
from evsdr.solve.shared.posterior import ROBUST, SLOPE_TERM, agreeing
from evsdr.solve.shared.rig import TIMES, Rig
from evsdr.solve.threshold_spread import SMALLEST_SPREAD

SENSOR = (*TIMES, "on", "off")  # unknowns after those of the model, as the kernel's columns
POWER_OF_SLOT = np.array([-1, 0, 0, -1, -1, 1, 0, 0, 0])  # by which their us become slots
LARGEST_GAIN = 1.0  # logarithm by which a pixel's threshold differs from that told

# x -> A (n_led, n_point), dA by each LED's own unknowns (n_led, n_point, n_own), dA by shared unknowns
# (n_led, n_point, n_shared). Unknowns: those of LED 0, of LED 1, ..., then the shared ones.
Model = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Belief:
    """Where a solution stands.

    Attributes
    ----------
    x : (n_unknown,) float
        Of the model, then of `SENSOR`: times in us, the refractory period over what is told; the unit of light is C_w.
    scatter : float
        Standard deviation of relative residuals.
    spread : (2,) float
        Of the logarithms of the pixels' own thresholds, where those are unknown.
    gains : list of (n_pixel, 2) float
        These logarithms, of each part.
    weigh : list of (n_event,) float
        See `kernel.pixel_sums`.
    heard : list of (n_pixel,) bool
        Pixels whose events agree with those of most.
    """

    x: np.ndarray
    scatter: float
    spread: np.ndarray
    gains: list
    weigh: list
    heard: list


@dataclass(frozen=True)
class Sums:
    """The likelihood of some parts.

    Attributes
    ----------
    cost : (n_pixel,)
        Of each pixel.
    heard : (n_pixel,) bool
        Those that count in what follows.
    score : (n_pixel, n_unknown)
        Gradient of each pixel.
    matrix : (n_unknown, n_unknown)
        Information.
    residual, variance : list of (n_event,)
        See `kernel.pixel_sums`.
    rest : list of (n_pixel, 2)
        Step of the pixels' own thresholds if nothing else moved.
    response : list of (n_pixel, 2, n_unknown)
        Of these to all else.
    left : list of (n_pixel, 2)
        Their variances, all else known.
    """

    cost: np.ndarray
    heard: np.ndarray
    score: np.ndarray
    matrix: np.ndarray
    residual: list
    variance: list
    rest: list
    response: list
    left: list

    @property
    def gradient(self) -> np.ndarray:
        return self.score.sum(axis=0)


def first_belief(parts: Sequence[Watched], x: np.ndarray, scatter: float, spread: float) -> Belief:
    """Start with thresholds as told."""
    return Belief(
        x,
        scatter,
        np.full(2, spread),
        [np.zeros((len(part.point), 2)) for part in parts],
        [np.zeros(len(part.events[1])) for part in parts],
        [np.ones(len(part.point), bool) for part in parts],
    )


def sum_parts(parts: Sequence[Watched], model: Model, belief: Belief, stirred: tuple[str, ...]) -> Sums:
    """Sum the likelihood over all pixels; `stirred` are those of `pixels.STEPS` by which derivatives are wanted."""
    modelled = model(belief.x[: -len(SENSOR)])
    of_parts = [_sum_part(k, part, modelled, belief, stirred) for k, part in enumerate(parts)]
    cost, score, matrix, *lists = zip(*of_parts)
    heard = np.concatenate(belief.heard)
    return Sums(np.concatenate(cost), heard, np.concatenate(score), sum(matrix), *map(list, lists))


def _sum_part(k: int, part: Watched, modelled: tuple, belief: Belief, stirred: tuple[str, ...]) -> tuple:
    signal = modelled[0]
    n_led, n_pixel = len(signal), len(part.point)
    sensor = belief.x[-len(SENSOR) :] * part.slot_us**POWER_OF_SLOT
    sensor[TIMES.index("refractory")] += part.refractory_us / part.slot_us
    signals = np.zeros((n_pixel, 4, n_led))
    signals[:, 0] = signal[:, part.point].T
    gains = belief.gains[k] if part.own_thresholds else sensor[-2:]
    cost, gradient, matrix, residual, variance = pixel_sums(
        part.events,
        np.where(part.order < 0, n_led, part.order).astype(np.int64),
        np.zeros(n_led, np.int64),
        1.0,
        signals,
        np.zeros((n_pixel, n_led, 0)),
        part.threshold * np.exp(gains),
        part.own_thresholds,
        stirred_values(
            Rig.of(np.concatenate([np.zeros(n_led), sensor, np.zeros(1 + 2 * n_led)]), n_led), stirred
        ),
        Terms(part.crossfade, belief.scatter, ROBUST, SLOPE_TERM),
        TABLE,
        belief.weigh[k],
    )
    own = slice(3, 5) if part.own_thresholds else slice(0, 0)
    first = own.stop or 3
    block, cross = matrix[:, own, own], matrix[:, own, first:]
    slope, gradient, matrix = gradient[:, own], gradient[:, first:], matrix[:, first:, first:]
    if part.own_thresholds:  # their distribution over the pixels
        off = (gains - sensor[-2:]) / belief.spread
        cost = cost + 0.5 * np.sum(off**2, axis=1)
        slope = slope + off / belief.spread
        for side, precision in enumerate(belief.spread**-2):
            column = n_led + ON + side
            gradient[:, column] -= off[:, side] / belief.spread[side]
            block[:, side, side] += precision
            cross[:, side, column] -= precision
            matrix[:, column, column] += precision
    inverse = np.linalg.inv(block)
    rest, response = -np.einsum("nij,nj->ni", inverse, slope), -inverse @ cross
    gradient = gradient + np.einsum("nij,ni->nj", response, slope)
    matrix = matrix + np.swapaxes(cross, 1, 2) @ response
    heard = belief.heard[k]
    matrix, lead = _chained(part, modelled, matrix * heard[:, None, None])
    score = lead((gradient * heard[:, None])[:, None])[:, 0]
    return cost, score, matrix, residual, variance, rest, lead(response), np.einsum("nii->ni", inverse)


def _chained(part: Watched, modelled: tuple, matrix: np.ndarray) -> tuple[np.ndarray, Callable]:
    """Lead information (n_pixel, m, m) back to the unknowns; gives also what does so with gradients (n_pixel, i, m).

    The signal of an LED depends on its own unknowns and on those that all share: sums run over these alone.
    """
    signal, own, shared = modelled
    n_led, n_own, n_shared, m = len(signal), own.shape[2], shared.shape[2], matrix.shape[1]
    point, row = np.unique(part.point, return_inverse=True)
    inverse = np.divide(1.0, signal, out=np.zeros_like(signal), where=signal > 0)[:, point, None]
    own = own[:, point] * inverse
    some = np.arange(len(SENSOR))
    rest = np.zeros((len(point), m, n_shared + len(SENSOR)))
    rest[:, :n_led, :n_shared] = np.moveaxis(shared[:, point] * inverse, 0, 1)
    rest[:, n_led + some, n_shared + some] = part.slot_us ** POWER_OF_SLOT.astype(float)
    gather = csr_array((np.ones(len(row)), (row, np.arange(len(row)))))
    of_point = (gather @ matrix.reshape(len(row), -1)).reshape(len(point), m, m)
    n_first = n_led * n_own
    summed = np.zeros((n_first + rest.shape[2],) * 2)
    turned = own.transpose(0, 2, 1)
    weighted = np.einsum("pjk,kpb->jpkb", of_point[:, :n_led, :n_led], own).reshape(
        n_led, len(point), n_first
    )
    summed[:n_first, :n_first] = (turned @ weighted).reshape(n_first, n_first)
    through = of_point @ rest
    summed[:n_first, n_first:] = (turned @ through[:, :n_led].swapaxes(0, 1)).reshape(n_first, -1)
    summed[n_first:, :n_first] = summed[:n_first, n_first:].T
    summed[n_first:, n_first:] = rest.reshape(-1, rest.shape[2]).T @ through.reshape(-1, rest.shape[2])
    of_pixel = own.swapaxes(0, 1)[row, None], rest[row]

    def lead(values: np.ndarray) -> np.ndarray:
        first = values[:, :, :n_led, None] * of_pixel[0]
        return np.concatenate([first.reshape(*values.shape[:2], n_first), values @ of_pixel[1]], axis=2)

    return summed, lead


def moved(belief: Belief, step: np.ndarray, sums: Sums, least: np.ndarray) -> Belief:
    """Give the belief after a step of all unknowns, which each pixel's own thresholds follow."""
    x = np.maximum(belief.x + step, least)
    follow = [
        np.clip(gains + rest + response @ (x - belief.x), -LARGEST_GAIN, LARGEST_GAIN) if rest.size else gains
        for gains, rest, response in zip(belief.gains, sums.rest, sums.response)
    ]
    return replace(belief, x=x, gains=follow)


def learnt(parts: Sequence[Watched], belief: Belief, sums: Sums) -> Belief:
    """Learn scatter and spread from what remains, and which pixels are heard."""
    residual, variance = np.concatenate(sums.residual), np.concatenate(sums.variance)
    counts = np.isfinite(residual)
    square = variance_of(residual[counts], ROBUST, variance[counts], NOISE_RANGE[0] ** 2)
    scatter, spread = float(np.sqrt(square)), belief.spread
    own = [
        (gains - belief.x[-2:]) ** 2 + left
        for part, gains, left in zip(parts, belief.gains, sums.left)
        if part.own_thresholds
    ]
    if own:
        spread = np.sqrt(np.maximum(np.concatenate(own).mean(axis=0), SMALLEST_SPREAD**2))
    heard = [
        agreeing(residual, variance, part.events[0], scatter)
        for part, residual, variance in zip(parts, sums.residual, sums.variance)
    ]
    return replace(belief, scatter=scatter, spread=spread, weigh=sums.variance, heard=heard)
