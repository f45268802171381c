"""How early noise fires an event: when a photoreceptor's noise first meets a threshold that comes nearer.

Behind a photoreceptor of time constant T, shot noise of log I is stationary with standard deviation sigma. A threshold
that comes nearer by s per T is met at a distance of `lead` standard deviations, whose distribution depends on
kappa = sigma / (s T), and on what the speed was before. As T dv/dt = log I - v, s T is |log I - v|: no speed has to be known.
On a steady ramp of log I it stays as it is, and where light rests it falls by all of itself per T.

Let noise have a second pole, r = 1 + 2 exp(pole) times as fast as the first; its velocity has the variance r / T^2. It
passes a level that sinks by w deviations per T upward phi(x) (sqrt(r) phi(w / sqrt(r)) + w Phi(w / sqrt(r))) times per T
(Rice 1945). The level has then met nothing down to x with a probability that is Phi(x) for fast levels, as noise is met as
it stands, and that of no passage for slow ones:

    log S(x) = -INT_x^oo N(w(y - x)) d log Phi(y),   N(w) = sqrt(r) phi(w / sqrt(r)) / w + Phi(w / sqrt(r)),
    w(d) = 1 / kappa   on a ramp,   1 / kappa + d   where light rests,

as a level that slows down was the faster the farther it was. Times being what is told, the lead has the density
S d log Phi / dx; for a steady level S = Phi^N, the largest of N independent tries.

Where light rested before it changed, pixels whose level was near have fired: that the others' level was not met at rest weighs
the lead by S of that rest, a deviation x there being x and what v has moved since. With S taken for that of a normal
distribution the weighed lead is skew-normal (Azzalini 1985).

Noise that meets a level rises: the velocity V (normal, of variance r) weighs by V + 1 / kappa, with which both come
nearer. What noise adds when the reference is memorised, own time t later, follows from level and velocity:

    lead a(t) + V b(t),   a = (r exp(-t) - exp(-r t)) / (r - 1),   b = (exp(-t) - exp(-r t)) / (r - 1).

On a ramp the lead depends on kappa sqrt(r) alone, and nearly so at rest: one table, made for r = `POLES`, holds for all.

Ramps count as steady though v comes to follow them as slowly as a step: a slowing that is told by log I - v is right for
simulated pixels, too, but normals under slots of 5 and 2 ms that fade came out 9 and 4 % worse so (three recordings each,
measured by hand).
"""

import math

import numpy as np
from numba import njit
from scipy.special import log_ndtr, ndtr

POLES = 3.0  # r where `pole` is 0: fits noise behind second poles of 2 to 5 within 0.2 deviations (the module's test)
# Of log10 kappa: the table's steps, its ends, and the largest of levels that do not come to rest, from which on steps grow in
# proportion: at rest 2.3 times it is own time
PER_DECADE, SMALLEST, LARGEST, MOVING = 8, -2.0, 300.0, 8.0
FARTHEST, N_LEVEL = (
    9.0,
    361,
)  # standard deviations of the table's levels; four times as many, or steps, change leads by .0015: measured
TINY = 1e-300
RESTED = 10.0  # kappa from which a level has come to rest; guessed
BEYOND = 8.0  # standard deviations by which v has moved: at rest noise came to 3.4, which is 4.6 of them below, and forgotten


@njit(cache=True)
def _place(log_kappa):
    """Give where in the table a log10 kappa stands."""
    return log_kappa if log_kappa < MOVING else MOVING * (1 + math.log(log_kappa / MOVING))


def _table() -> np.ndarray:
    """Give mean and variance of the lead (2, 2, n_kappa): of steady levels, and where light rests."""
    level = np.linspace(-FARTHEST, FARTHEST, N_LEVEL)
    rarer = np.exp(-0.5 * level**2 - log_ndtr(level)) / np.sqrt(2 * np.pi)  # d log Phi
    # Parts of the way down to a level, and their ends: within one w changes by much where it is small
    part = np.append(0, np.arange(N_LEVEL) + 0.5) * (level[1] - level[0])
    wide, here = np.diff(part), np.append(0.5 * part[1], 0.5 * (part[1:-1] + part[2:]))
    place = SMALLEST + np.arange(int((_place(LARGEST) - SMALLEST) * PER_DECADE) + 1) / PER_DECADE
    kappa = 10 ** np.where(place < MOVING, place, MOVING * np.exp(np.maximum(place / MOVING - 1, 0)))
    out = np.empty((2, 2, len(kappa)))
    for slowing in (0, 1):
        for j, rest in enumerate(1 / kappa):
            ends = rest + slowing * part
            passing = np.log(ends[1:] / ends[:-1]) if slowing else wide / rest  # INT dd / w
            w = (rest + slowing * here) / np.sqrt(POLES)
            tries = np.sqrt(POLES / (2 * np.pi)) * np.exp(-0.5 * w**2) * passing + ndtr(w) * wide
            met = np.correlate(np.append(rarer, np.zeros(N_LEVEL - 1)), tries, mode="valid")
            probability = np.exp(np.log(rarer) - met - (np.log(rarer) - met).max())
            probability /= probability.sum()
            out[0, slowing, j] = probability @ level
            out[1, slowing, j] = probability @ level**2 - out[0, slowing, j] ** 2
    return out


TABLE = _table()


@njit(cache=True)
def poles_of(pole):
    """Give r, above 1 whatever `pole` is."""
    return 1 + (POLES - 1) * math.exp(pole)


@njit(cache=True, error_model="numpy")
def lead_of(table, noise, late, rest, pole):
    """Give mean and variance of the lead, and the mean velocity, of an event.

    Parameters
    ----------
    table : (2, 2, n_kappa) float64
        `TABLE`.
    noise : float
        Standard deviation of log I, above 0.
    late : float
        log I - v.
    rest : (bool, float, float)
        Whether light rests, by how much v has moved since it did before, and log I - v when that ended: `receptor.since_rest`.
    pole : float
    """
    rests, moved, late_at_rest = rest
    mean, variance, velocity = read_lead(table, noise / max(abs(late), TINY), rests, pole)
    kappa = noise / max(abs(late_at_rest), TINY)
    if abs(moved) < BEYOND * noise and kappa > RESTED:
        at_rest, its_variance, _ = read_lead(table, kappa, True, pole)
        width = math.sqrt(variance + its_variance)
        z = (at_rest - abs(moved) / noise - mean) / width
        above = 0.5 * math.erfc(z * 0.7071067811865476)
        hazard = math.exp(-0.5 * z * z) * 0.3989422804014327 / above
        mean += variance / width * hazard
        variance -= (variance / width) ** 2 * hazard * (hazard - z)
    return mean, variance, velocity


@njit(cache=True)
def read_lead(table, kappa, rests, pole):
    """Give mean and variance of the lead, and the mean velocity, at a kappa."""
    poles = poles_of(pole)
    log_kappa = math.log10(max(kappa * math.sqrt(poles / POLES), TINY))
    if not rests:
        log_kappa = min(log_kappa, MOVING)
    at = max((_place(log_kappa) - SMALLEST) * PER_DECADE, 0.0)
    k = min(int(at), table.shape[2] - 2)
    part = min(at - k, 1.0)
    here, there = table[:, int(rests), k], table[:, int(rests), k + 1]
    mean = here[0] + part * (there[0] - here[0])
    return mean, here[1] + part * (there[1] - here[1]), _rise(kappa, poles)


@njit(cache=True, error_model="numpy")
def _rise(kappa, poles):
    """Give the mean velocity of noise that meets a level, in standard deviations per time constant."""
    s = math.sqrt(poles)
    w = 1 / (kappa * s)
    below = 0.5 * math.erfc(-w * 0.7071067811865476)
    return s * below / (math.exp(-0.5 * w * w) * 0.3989422804014327 + w * below)


@njit(cache=True, error_model="numpy")
def kept(own_time, pole):
    """Give the shares of level and velocity that noise still has after a time, in its own."""
    poles = poles_of(pole)
    slow, fast = math.exp(-own_time), math.exp(-poles * own_time)
    return (poles * slow - fast) / (poles - 1), (slow - fast) / (poles - 1)
