"""The event log-ratio loss and its normal equations, summed over the pairs of each pixel.

A pair of events says  log I(t_k) - log I(t_(k-1) + refractory) = p_k C  (EventSpecPS eq. 5, with the
reference memorised at the end of the refractory period). Its residual is relative to the threshold,

    u = p_k f / C - 1,    f = log I(end) - log I(start),

because an absolute one vanishes together with the contrast.

When an event fires is chosen by its own noise: light that changes fast meets more thresholds in a given time. Its
time therefore has the density  N(u) |df/dt| / C  (N: of the threshold's noise), whose logarithm adds a slope term to
the squared residual. Left out, signals come out too weak by about the noise squared.

Silence speaks too: where no event has fired since the reference was memorised, log I has changed by less than
the threshold. While LEDs fade linearly the light is extreme at the starts of slots, so those are the probes.

Nothing here knows Mitsuba.
"""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.model.arrays import columns
from evsdr.solve.pair_data import (
    PairData,
    Table,
    ends,
    every_pair,
    lit_leds,
    signal_table,
    unpack_pair,
)

SILENT_MARGIN = 1.0  # standard deviations of the threshold that silence leaves open
SMALLEST_SLOPE = 0.02  # of log I per slot: what is slower, or has the wrong sign, counts as nearly this


def relative_residual(table: Table, pairs: PairData, constant_light, k, pixel, active):
    """Give u of pair k, of that pixel, and the threshold C that it met.

    Differentiable in the table of signals.
    """
    Float = type(pairs.phases)
    start, end, polarity = ends(table, pairs, k, pixel, active)
    on, off = (dr.gather(Float, value, pixel, active) for value in (pairs.threshold_on, pairs.threshold_off))
    threshold = dr.select(polarity > 0, on, off)
    u = polarity * dr.log((end + constant_light) / (start + constant_light)) / threshold - 1.0
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
        loss.robust,
    )
    slope_term = gaussian_share(loss.robust) if loss.density else 0.0
    cost, gradient, matrix = normal_equations(*given, unknowns.thresholds, slope_term)
    if loss.silence and pairs.silent_offset is not None:
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


def _unpack_entry(entry):
    """Give signal, its slope derivatives, band and diffuse part of an entry of `derivative_table`."""
    signal, by_p, by_q, coded = entry
    band = dr.floor(coded)
    return signal, by_p, by_q, band, 2.0 * (coded - band) * signal


def gaussian_share(robust: float) -> float:
    """Give E[z^2 w(z)] for standard normal z and Cauchy's weight w.

    The weight of the slope term with which it balances robust residuals of Gaussian noise on average.
    """
    z, weight = np.polynomial.hermite_e.hermegauss(80)
    return float(weight @ (z**2 / (1 + (z / robust) ** 2)) / weight.sum())


def normal_equations(
    table,
    pairs: PairData,
    constant_light,
    n_band: int,
    scale,
    robust,
    thresholds: bool = False,
    slope_term: float = 0.0,
):
    """Sum cost, gradient and Gauss-Newton matrix of each pixel over its pairs.

    The cost of a pair is Cauchy's, robust^2 / 2 log(1 + (r / robust)^2) for r = u / scale, less `slope_term` times
    the logarithm of p_k df/dt / C.

    Parameters
    ----------
    table : Table
        See `derivative_table`.
    constant_light : Float
        C_w, above 0.
    n_band : int
        Number of bands.
    scale : Float
        Standard deviation of u.
    robust : Float
        Width of the Cauchy cost in standard deviations.
    thresholds : bool
        Whether the logarithms of C_on and C_off are unknowns too.
    slope_term : float
        Weight of the density of event times, see `gaussian_share`; 0 leaves it out.

    Returns
    -------
    cost : Float, (n_pixel)
    gradient : list of Float, (n)
        By p, q, the log reflectances, and log C_on, log C_off if asked for.
    matrix : list of Float, (n (n + 1) / 2)
        Lower triangle, row after row.
    """

    def event(change, polarity):
        on = polarity > 0
        threshold = dr.select(on, pairs.threshold_on, pairs.threshold_off)
        u = polarity * change / threshold - 1.0
        more = [(-u - 1.0, on), (-u - 1.0, ~on)] if thresholds else []
        return u, polarity / threshold, more

    def density(lit, total, jacobian, polarity, fading):
        """Cost and gradient of the slope term; jacobian is that of log I at the event."""
        (_, (signal_0, *slopes_0, band_0, diffuse_0)), (_, (signal_1, *slopes_1, band_1, diffuse_1)) = lit
        speed = polarity * (signal_1 - signal_0) / total  # of log I, per slot
        root = dr.sqrt(dr.square(speed) + dr.square(SMALLEST_SLOPE))
        by = [b - a for a, b in zip(slopes_0, slopes_1)]
        for b in range(n_band):
            by.append(dr.select(band_1 == b, diffuse_1, 0.0) - dr.select(band_0 == b, diffuse_0, 0.0))
        gradient = [-(polarity * d / total - speed * j) / root for d, j in zip(by, jacobian)]
        cost = -dr.log(0.5 * (speed + root))
        if thresholds:
            on = polarity > 0
            cost += dr.log(dr.select(on, pairs.threshold_on, pairs.threshold_off))
            gradient += [dr.select(side, Float(1.0), 0.0) for side in (on, ~on)]
        return dr.select(fading, cost, 0.0), [dr.select(fading, g, 0.0) for g in gradient]

    Float = type(pairs.phases)
    lists = pairs.offset, pairs.phases
    n_more = 2 if thresholds else 0
    given = constant_light, n_band, scale, robust
    slope = density if slope_term else None, slope_term
    return _sum_terms(table, pairs, *lists, event, n_more, *given, *slope, pairs.weight)


def silence_equations(
    table, pairs: PairData, constant_light, n_band: int, scale, robust, thresholds: bool = False
):
    """Sum cost, gradient and matrix over the silent probes, as `normal_equations` does over the events.

    The residual is what the change exceeds the threshold by, beyond `SILENT_MARGIN` standard deviations of
    the threshold's own noise; 0 below.
    """

    def excess(change, _):
        over = change > 0
        threshold = dr.select(over, pairs.threshold_on, -pairs.threshold_off)
        beyond = change / threshold - 1.0 - SILENT_MARGIN * scale
        more = [(-change / threshold, (beyond > 0) & side) for side in (over, ~over)] if thresholds else []
        return dr.maximum(beyond, 0.0), dr.select(beyond > 0, dr.rcp(threshold), 0.0), more

    lists = pairs.silent_offset, pairs.silent_phases
    n_more = 2 if thresholds else 0
    return _sum_terms(table, pairs, *lists, excess, n_more, constant_light, n_band, scale, robust)


def _sum_terms(
    table,
    pairs,
    offset,
    phases,
    residual,
    n_more,
    constant_light,
    n_band,
    scale,
    robust,
    density=None,
    slope_term=0.0,
    weights=None,
):
    """Sum over one list of phase pairs.

    `residual(change of log I, polarity)` gives u, du/d(change), and for each of `n_more` unknowns of its own the
    derivative of u and where it counts. `density`, if given, gives cost and gradient of the slope term. `weights`,
    if given, say how much each entry of the list counts.
    """
    Float, UInt32 = type(phases), type(offset)
    n = 2 + n_band + n_more
    pixel = dr.arange(UInt32, dr.width(pairs.threshold_on))
    first = dr.gather(UInt32, offset, pixel)
    last = dr.gather(UInt32, offset, pixel + 1)

    def body(k, cost, *sums):
        active = k < last
        *phases_of_pair, polarity = unpack_pair(phases, k, active)
        logarithm, by = [], []
        for phase in phases_of_pair:
            lit = [
                (share, _unpack_entry(table.at(pixel, led, active)))
                for led, share in lit_leds(pairs, phase, active)
            ]
            total = constant_light + sum(share * entry[0] for share, entry in lit)
            derivative = [Float(0.0) for _ in range(2 + n_band)]
            for share, (_, by_p, by_q, band, diffuse) in lit:
                part = share / total
                derivative[0] += part * by_p
                derivative[1] += part * by_q
                for b in range(n_band):
                    derivative[2 + b] += dr.select(band == b, part * diffuse, 0.0)
            logarithm.append(dr.log(total))
            by.append(derivative)
        u, gain, more = residual(logarithm[1] - logarithm[0], polarity)
        r, gain = u / scale, gain / scale
        excess = dr.square(r / robust)
        given = 1.0 if weights is None else dr.gather(Float, weights, k, active)
        weight = given * dr.rcp(1.0 + excess)
        cost += given * 0.5 * dr.square(robust) * dr.log(1.0 + excess)
        jacobian = [gain * (end - start) for start, end in zip(*by)]
        jacobian += [dr.select(where, value / scale, 0.0) for value, where in more]
        weighted = [weight * j for j in jacobian]
        gradient = [w * r for w in weighted]
        matrix = [weighted[i] * jacobian[j] for i in range(n) for j in range(i + 1)]
        if density:
            fading = active & (phases_of_pair[1] > dr.floor(phases_of_pair[1]))
            slope_cost, slope = density(lit, total, by[1], polarity, fading)
            cost += given * slope_term * slope_cost
            scaled = [given * slope_term * s for s in slope]
            gradient = [g + s for g, s in zip(gradient, scaled)]
            squares = (scaled[i] * slope[j] for i in range(n) for j in range(i + 1))
            matrix = [m + s for m, s in zip(matrix, squares)]
        return (k + 1, cost, *(s + t for s, t in zip(sums, gradient + matrix)))

    zero = [dr.zeros(Float, dr.width(pixel)) for _ in range(1 + n + n * (n + 1) // 2)]
    state = dr.while_loop((first, *zero), lambda k, *_: k < last, body, label="event terms")
    return state[1], list(state[2 : 2 + n]), list(state[2 + n :])
