"""How early noise fires an event: when a photoreceptor's noise first meets a threshold that comes nearer.

Behind a photoreceptor of time constant T, shot noise of log I is stationary with standard deviation sigma. A threshold
that comes nearer by s per T is met at a distance of `lead` standard deviations, whose distribution depends on
kappa = sigma / (s T) alone. As T dv/dt = log I - v, s T is |log I - v|: no speed has to be known.

Let noise have a second pole, r = 1 + 2 exp(pole) times as fast as the first; its velocity has the variance r / T^2. It
passes a level that sinks by w = 1 / kappa deviations per T upward phi(x) (sqrt(r) phi(w / sqrt(r)) + w Phi(w / sqrt(r)))
times per T (Rice 1945). The level has then met nothing down to x with a probability that is Phi(x) for fast levels, as
noise is met as it stands, and that of no passage for slow ones: of the largest of N independent tries,

    S(x) = Phi(x)^N,    N = kappa sqrt(r) phi(w / sqrt(r)) + Phi(w / sqrt(r)).

Noise that meets a level rises: the velocity V (normal, of variance r) weighs by V + 1 / kappa, with which both come
nearer. What noise adds when the reference is memorised, own time t later, follows from level and velocity:

    lead a(t) + V b(t),   a = (r exp(-t) - exp(-r t)) / (r - 1),   b = (exp(-t) - exp(-r t)) / (r - 1).

The lead depends on kappa sqrt(r) alone, so one table, made for r = `POLES`, holds for all.
"""

import math

import numpy as np
from numba import njit
from scipy.special import log_ndtr, ndtr

POLES = 3.0  # r where `pole` is 0: fits noise behind second poles of 2 to 5 within 0.2 deviations (the module's test)
PER_DECADE, SMALLEST, LARGEST = 10, -2.0, 8.0  # of log10 kappa
TRIES = 3.0  # kappa of a time constant at rest: noise passes levels of 2 or 3 deviations that much more often
TINY = 1e-12


def _table() -> np.ndarray:
    """Give mean and variance of the lead."""
    x = np.linspace(-9.0, 9.0, 1801)
    kappa = 10 ** np.linspace(SMALLEST, LARGEST, int((LARGEST - SMALLEST) * PER_DECADE) + 1)
    w = 1 / (kappa * np.sqrt(POLES))
    tries = kappa * np.sqrt(POLES / (2 * np.pi)) * np.exp(-0.5 * w**2) + ndtr(w)
    probability = np.diff(np.exp(tries[:, None] * log_ndtr(x)), axis=1)
    middle = 0.5 * (x[1:] + x[:-1])
    mean = probability @ middle
    return np.array([mean, probability @ middle**2 - mean**2])


TABLE = _table()


@njit(cache=True)
def poles_of(pole):
    """Give r, above 1 whatever `pole` is."""
    return 1 + (POLES - 1) * math.exp(pole)


@njit(cache=True, error_model="numpy")
def lead_of(table, noise, late, own, at, nodes, crossfade, pole):
    """Give mean and variance of the lead, and the mean velocity, of an event.

    Parameters
    ----------
    table : (2, n) float64
        `TABLE`.
    noise : float
        Standard deviation of log I, above 0.
    late : float
        log I - v.
    own : float
        Rate of the receptor's own time.
    at : float
        Slot + the fraction of it that is over.
    nodes : (n_slot, ...) float64
        See `receptor.follow`.
    crossfade : float
    pole : float
    """
    kappa = noise / max(abs(late), TINY)
    slot = min(int(at), len(nodes) - 1)
    if at - slot < 1 - crossfade:  # the light rests: noise has tried since it came to rest
        kappa = min(kappa, noise / max(abs(nodes[slot, 0]), TINY) + TRIES * own * (at - slot))
    return read_lead(table, kappa, pole)


@njit(cache=True)
def read_lead(table, kappa, pole):
    """Give mean and variance of the lead, and the mean velocity, at a kappa."""
    poles = poles_of(pole)
    same = kappa * math.sqrt(poles / POLES)
    at = max((math.log10(max(same, TINY)) - SMALLEST) * PER_DECADE, 0.0)
    k = min(int(at), table.shape[1] - 2)
    part = min(at - k, 1.0)
    mean = table[0, k] + part * (table[0, k + 1] - table[0, k])
    return mean, table[1, k] + part * (table[1, k + 1] - table[1, k]), _rise(kappa, poles)


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
