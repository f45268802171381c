"""What events say: normal equations of each pixel, summed over its pairs."""

import drjit as dr

from evsdr.solve import law
from evsdr.solve.light import Light
from evsdr.solve.pair_data import PairData, change_of_log, unpack_pair


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

    The cost of a pair is Cauchy's for r = u / scale, less `slope_term` times the logarithm of p_k df/dt / C.

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
        Width of Cauchy's cost in standard deviations.
    thresholds : bool
        Whether the logarithms of C_on and C_off are unknowns too.
    slope_term : float
        Weight of the density of event times, see `law.gaussian_share`; 0 leaves it out.

    Returns
    -------
    cost : Float, (n_pixel)
    gradient : list of Float, (n)
        By p, q, the log reflectances, and log C_on, log C_off if asked for.
    matrix : list of Float, (n (n + 1) / 2)
        Lower triangle, row after row.
    """
    Float, UInt32 = type(pairs.phases), type(pairs.first)
    n = 2 + n_band + 2 * thresholds
    pixel = dr.arange(UInt32, dr.width(pairs.threshold_on))
    light = Light(table, pairs, constant_light, n_band)

    def body(k, cost, *sums):
        active = k < pairs.last
        start, end, polarity = unpack_pair(pairs.phases, k, active)
        lit = light.entries(pixel, end, active)
        total_start, by_start = light.of(light.entries(pixel, start, active))
        total, by_end = light.of(lit)
        sides = (polarity > 0, polarity < 0) if thresholds else ()
        threshold = dr.select(polarity > 0, pairs.threshold_on, pairs.threshold_off)
        gain = polarity / threshold
        change, answer_start, answer = change_of_log(pairs, total_start, total, k, active)
        r = (gain * change - 1.0) / scale
        gain = gain / scale
        jacobian = [gain * (answer * b - answer_start * a) for a, b in zip(by_start, by_end)]
        jacobian += [dr.select(side, -r - dr.rcp(scale), 0.0) for side in sides]
        value, weight = law.cauchy(0.5 * dr.square(r), robust)
        given = 1.0 if pairs.weight is None else dr.gather(Float, pairs.weight, k, active)
        weighted = [given * weight * j for j in jacobian]
        cost += given * value
        gradient = [w * r for w in weighted]
        matrix = [weighted[i] * jacobian[j] for i in range(n) for j in range(i + 1)]
        if slope_term:
            rarity, slope, share = _rarity(lit, total, by_end, polarity, threshold, n_band)
            fading = active & (end > dr.floor(end))
            counted = dr.select(fading, given * slope_term, 0.0)
            cost += counted * rarity
            slope += [dr.select(side, share, 0.0) for side in sides]
            scaled = [counted * s for s in slope]
            gradient = [g + s for g, s in zip(gradient, scaled)]
            squares = (scaled[i] * slope[j] for i in range(n) for j in range(i + 1))
            matrix = [m + s for m, s in zip(matrix, squares)]
        return (k + 1, cost, *(s + t for s, t in zip(sums, gradient + matrix)))

    zero = [dr.zeros(Float, dr.width(pixel)) for _ in range(1 + n + n * (n + 1) // 2)]
    state = dr.while_loop((pairs.first, *zero), lambda k, *_: k < pairs.last, body, label="event terms")
    return state[1], list(state[2 : 2 + n]), list(state[2 + n :])


def _rarity(lit, total, jacobian, polarity, threshold, n_band):
    """Give -log of p df/dt in thresholds, its derivatives by p, q and log reflectances, and that by the log threshold.

    Thresholds and contrasts that shrink together leave it as it is. `jacobian` is that of log I at the event.
    """
    (_, (signal_0, *slopes_0, band_0, diffuse_0)), (_, (signal_1, *slopes_1, band_1, diffuse_1)) = lit
    speed = polarity * (signal_1 - signal_0) / total  # of log I, per slot
    root = dr.sqrt(dr.square(speed) + dr.square(law.SLOWEST * threshold))
    by = [b - a for a, b in zip(slopes_0, slopes_1)]
    for b in range(n_band):
        by.append(dr.select(band_1 == b, diffuse_1, 0.0) - dr.select(band_0 == b, diffuse_0, 0.0))
    gradient = [-(polarity * d / total - speed * j) / root for d, j in zip(by, jacobian)]
    return -dr.log(0.5 * (speed + root) / threshold), gradient, speed / root
