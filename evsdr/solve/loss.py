"""The event log-ratio loss and its normal equations, summed over the pairs of each pixel.

A pair of events says  log I(t_k) - log I(t_(k-1) + refractory) = p_k C  (EventSpecPS eq. 5, with the
reference memorised at the end of the refractory period). Its residual is relative to the threshold,

    u = p_k f / C - 1,    f = log I(end) - log I(start),

because an absolute one vanishes together with the contrast.

The likelihood is that of a first passage: after each event an ON and an OFF threshold are drawn anew, and the light
reaches one of them first. The time of an event has the density N(u) |df/dt| / C of its own threshold, N that of the
threshold's noise (`event_terms`; light that changes fast meets more thresholds in a given time), times the probability
that the other was not reached before; silence has that of both (`silence_terms`). Without the density signals come out
too weak by about the noise squared, and without what was not reached thresholds too low by as much.

Nothing here knows Mitsuba.
"""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.model.arrays import columns
from evsdr.solve import law
from evsdr.solve.event_terms import normal_equations
from evsdr.solve.pair_data import (
    PairData,
    Table,
    change_of_log,
    ends,
    every_pair,
    signal_table,
)
from evsdr.solve.silence_terms import silence_equations


def relative_residual(table: Table, pairs: PairData, constant_light, k, pixel, active):
    """Give u of pair k, of that pixel, and the threshold C that it met.

    Differentiable in the table of signals.
    """
    Float = type(pairs.phases)
    start, end, polarity = ends(table, pairs, k, pixel, active)
    on, off = (dr.gather(Float, value, pixel, active) for value in (pairs.threshold_on, pairs.threshold_off))
    threshold = dr.select(polarity > 0, on, off)
    change = change_of_log(pairs, start + constant_light, end + constant_light, k, active)[0]
    u = polarity * change / threshold - 1.0
    return dr.select(active, u, 0.0), threshold


def residuals(model, pairs: PairData, constant_light, theta: list, gains: list | None = None):
    """Give the relative residual u of every pair.

    Parameters
    ----------
    model : callable
        Forward model.
    pairs : PairData
    constant_light : Float
        C_w.
    theta : list of Float, or (n_pixel, n_unknown) array
        Slopes and log reflectances; more is not looked at.
    gains : list of Float, optional
        Factors on C_on and C_off of each pixel.

    Returns
    -------
    Float, (n_pair)
    """
    theta = columns(type(pairs.phases), theta) if isinstance(theta, np.ndarray) else theta
    n_band = model.illumination.n_band
    reflectance = [dr.exp(t) for t in theta[2 : 2 + n_band]]
    signal, *_ = model(theta[0], theta[1], reflectance, dr.opaque(type(theta[0]), model.illumination.horizon))
    table = signal_table(signal, dr.width(theta[0]))
    given = scaled(pairs, gains), constant_light, *every_pair(pairs), True
    return relative_residual(table, *given)[0]


def scaled(pairs: PairData, gains: list | None) -> PairData:
    """Give pairs whose thresholds are multiplied by factors on C_on and C_off, if there are any."""
    if gains is None:
        return pairs
    on, off = pairs.threshold_on * gains[0], pairs.threshold_off * gains[1]
    return replace(pairs, threshold_on=on, threshold_off=off)


# ---------------------------------------------------------------------- normal equations


@dataclass(frozen=True)
class Loss:
    """Which terms count.

    Attributes
    ----------
    robust : float
        Width of the Cauchy cost in standard deviations.
    density : bool
        Whether the density of event times counts.
    silence : bool
        Whether that no event fired counts.
    """

    robust: float
    density: bool = False
    silence: bool = False


def system_table(system, theta: list) -> Table:
    """Lay out what the model of a `system.PixelSystem` gives for some unknowns, with its derivatives."""
    reflectance = system.unknowns.reflectance(theta)
    signal, by_p, by_q, *diffuse = system.model(theta[0], theta[1], reflectance, system.softness)
    diffuse = diffuse[0] if diffuse else None
    band = system.model.illumination.band
    return derivative_table(signal, by_p, by_q, band, dr.width(theta[0]), diffuse, system.room)


def pixel_terms(system, theta: list) -> tuple:
    """Sum cost, gradient and Gauss-Newton matrix of each pixel over all that it tells.

    Parameters
    ----------
    system : system.PixelSystem
        What is given.
    theta : list of Float
        See `unknowns`.
    """
    unknowns, loss, pairs = system.unknowns, system.loss, scaled(system.pairs, system.unknowns.gains(theta))
    given = (
        system_table(system, theta),
        pairs,
        system.constant_light,
        unknowns.n_band,
        system.noise,
    )
    slope_term = law.gaussian_share(loss.robust) if loss.density else 0.0
    cost, gradient, matrix = normal_equations(*given, loss.robust, unknowns.thresholds, slope_term)
    if loss.silence and pairs.silent_first is not None:
        more = silence_equations(*given, unknowns.thresholds)
        cost = cost + more[0]
        gradient, matrix = ([a + b for a, b in zip(*two)] for two in zip((gradient, matrix), more[1:]))
    return cost, gradient, matrix


def derivative_table(
    signal: list, by_p: list, by_q: list, band: list, n_pixel: int, diffuse: list | None = None, room=None
) -> Table:
    """Lay signals, their slope derivatives and the LED's band out for one look-up each.

    To the number of the band half the share of the signal that is diffuse is added: only that scales with the
    reflectance. By default it is all.

    Returns
    -------
    Table
        Of four values each.
    """
    one = type(signal[0])(1.0)
    diffuse = diffuse or signal
    share = [dr.select(a > 0, d / a, one) for a, d in zip(signal, diffuse)]
    rows = [[*row, b + 0.5 * s] for *row, b, s in zip(signal, by_p, by_q, band, share)]
    return Table.of(rows, n_pixel, room)
