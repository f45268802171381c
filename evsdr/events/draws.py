"""Random numbers: splitmix64 (Steele et al. 2014), one stream per pixel, and normal deviates by a ziggurat."""

import math

import numpy as np
from numba import njit


def _ziggurat(n: int = 256, start: float = 3.6541528853610088) -> tuple[np.ndarray, np.ndarray]:
    """Give the edges (n + 1,) of layers of equal area below exp(-x^2 / 2), and the density there (Marsaglia and Tsang
    2000); `start` is theirs, for 256 layers."""
    density = np.exp(-0.5 * start**2)
    area = start * density + np.sqrt(np.pi / 2) * math.erfc(start / np.sqrt(2))
    edge = np.empty(n + 1)
    edge[:2] = area / density, start
    for k in range(2, n):
        density += area / edge[k - 1]
        edge[k] = np.sqrt(-2 * np.log(density))
    edge[n] = 0
    return edge, np.exp(-0.5 * edge**2)


EDGE, DENSITY = _ziggurat()


@njit(cache=True)
def _draw_bits(state):
    """Give the next state and 64 random bits."""
    state += np.uint64(0x9E3779B97F4A7C15)
    z = state
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state, z ^ (z >> np.uint64(31))


@njit(cache=True)
def _draw_uniform(state):
    """Give the next state and a number in (0, 1)."""
    state, bits = _draw_bits(state)
    return state, (np.float64(bits >> np.uint64(11)) + 0.5) * 2.0**-53


@njit(cache=True, forceinline=True)
def draw_normal(state):
    """Give the next state and a normal deviate."""
    state, bits = _draw_bits(state)
    k = np.int64(bits & np.uint64(255))
    x = ((np.float64(bits >> np.uint64(11)) + 0.5) * 2.0**-52 - 1) * EDGE[k]
    return (state, x) if abs(x) < EDGE[k + 1] else _draw_rarely(state, k, x)


@njit(cache=True)
def _draw_rarely(state, k, x):
    """Give the next state and a normal deviate, once x has left the rectangle within layer k."""
    while True:
        state, u = _draw_uniform(state)
        if k > 0:
            if DENSITY[k] + u * (DENSITY[k + 1] - DENSITY[k]) < np.exp(-0.5 * x * x):
                return state, x
        else:
            state, other = _draw_uniform(state)  # the tail
            beyond = -np.log(u) / EDGE[1]
            if -2 * np.log(other) > beyond * beyond:
                return state, EDGE[1] + beyond if x > 0 else -EDGE[1] - beyond
        state, bits = _draw_bits(state)
        k = np.int64(bits & np.uint64(255))
        x = ((np.float64(bits >> np.uint64(11)) + 0.5) * 2.0**-52 - 1) * EDGE[k]
        if abs(x) < EDGE[k + 1]:
            return state, x
