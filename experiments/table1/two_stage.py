"""The two-stage event pipeline, written from its papers: normals by EventPS (Yu et al. 2024), then spectra.

First white light goes round; each pair of events gives a vector that is normal to the surface normal. Then the
bands light the object from the front, one after another, beside a constant light (Yu et al. 2025); the events of a pixel
tell its signal in each band, which the normal's cosine turns into reflectance, up to one factor of the scene.
"""

import numpy as np

from evsdr import Events

GRAZING = 0.1  # cosine below which a spectrum is not divided by it any more
FIRST, LOG_RANGE = 0.3, (np.log(1e-3), np.log(3.0))  # signals: start, and what they can be
STEPS, DAMPING = 25, 1e-3  # of Gauss-Newton


def solve_stages(
    stages: dict[str, tuple[Events, np.ndarray, float]],
    light: np.ndarray,
    threshold: float,
    refractory_us: float,
    constant_light: float,
    shape: tuple[int, int],
) -> tuple[np.ndarray, np.ndarray]:
    """Solve for normals (H, W, 3), then reflectances (H, W, n_band).

    Parameters
    ----------
    stages : dict
        `normal` and `spectrum`: events, order of the lights (-1 for none), and length of a slot [us].
    light : (n_led, 3) float
        Unit vectors to the white lights.
    threshold : float
        As told.
    """
    n_pixel = shape[0] * shape[1]
    *pairs, pixel = pairs_of(*stages["normal"], len(light), refractory_us, shape)
    normal = null_vectors(pair_rows(*pairs, threshold) @ light, pixel, n_pixel)
    normal *= np.where(normal[:, 2:] < 0, -1.0, 1.0)

    n_band = int(stages["spectrum"][1].max()) + 1
    *pairs, pixel = pairs_of(*stages["spectrum"], n_band, refractory_us, shape)
    signal = signals(*pairs, pixel, n_pixel, threshold, constant_light)
    reflectance = signal / np.maximum(normal[:, 2:], GRAZING)
    return normal.reshape(*shape, 3), reflectance.reshape(*shape, n_band)


def signals(
    start: np.ndarray,
    end: np.ndarray,
    up: np.ndarray,
    pixel: np.ndarray,
    n_pixel: int,
    threshold: float,
    constant_light: float,
) -> np.ndarray:
    """Fit the signal (n_pixel, n_light) of each light to pairs: Gauss-Newton of log I(end) - log I(start) = p C."""
    log_signal = np.full((n_pixel, start.shape[1]), np.log(FIRST))
    change = np.where(up, threshold, -threshold)
    n_light = start.shape[1]
    for _ in range(STEPS):
        signal = np.exp(log_signal)[pixel]
        before, after = ((w * signal).sum(axis=1) + constant_light for w in (start, end))
        slope = signal * (end / after[:, None] - start / before[:, None])
        left = change - np.log(after / before)
        system = per_pixel(slope[:, :, None] * slope[:, None, :], pixel, n_pixel)
        held = system + (DAMPING * np.trace(system, axis1=1, axis2=2)[:, None, None] + 1e-9) * np.eye(n_light)
        step = np.linalg.solve(held, per_pixel(slope * left[:, None], pixel, n_pixel)[..., None])[..., 0]
        log_signal = np.clip(log_signal + np.clip(step, -1, 1), *LOG_RANGE)
    return np.exp(log_signal)


def per_pixel(values: np.ndarray, pixel: np.ndarray, n_pixel: int) -> np.ndarray:
    """Sum what pairs (n_pair, ...) have, for each pixel."""
    flat = values.reshape(len(values), -1)
    total = np.stack([np.bincount(pixel, column, n_pixel) for column in flat.T], axis=-1)
    return total.reshape(n_pixel, *values.shape[1:])


def pair_rows(start: np.ndarray, end: np.ndarray, up: np.ndarray, threshold: float) -> np.ndarray:
    """Give what is 0 times the signals of the lights: I(end) - exp(p C) I(start), from their weights (n_pair, n_light)."""
    return end - np.exp(np.where(up, threshold, -threshold))[:, None] * start


def pairs_of(
    events: Events,
    order: np.ndarray,
    slot_us: float,
    n_light: int,
    refractory_us: float,
    shape: tuple[int, int],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Give the weights of the lights (n_pair, n_light) at both ends of each pair, polarities, and pixels."""
    pixel = events.y.astype(np.int64) * shape[1] + events.x
    first = np.lexsort((events.t, pixel))
    pixel, t, up = pixel[first], events.t[first].astype(float), events.p[first] == 1
    same = pixel[1:] == pixel[:-1]
    given = order, slot_us, n_light
    start, end = weights(t[:-1][same] + refractory_us, *given), weights(t[1:][same], *given)
    return start, end, up[1:][same], pixel[1:][same]


def weights(t_us: np.ndarray, order: np.ndarray, slot_us: float, n_light: int) -> np.ndarray:
    """Give how bright each light (n, n_light) is at some times, fading all the while."""
    slot, share = np.divmod(t_us / slot_us, 1.0)
    slot = slot.astype(int)
    out = np.zeros((len(t_us), n_light + 1))  # the last column is darkness, -1
    np.add.at(out, (np.arange(len(t_us)), order[slot % len(order)]), 1 - share)
    np.add.at(out, (np.arange(len(t_us)), order[(slot + 1) % len(order)]), share)
    return out[:, :-1]


def null_vectors(rows: np.ndarray, pixel: np.ndarray, n_pixel: int) -> np.ndarray:
    """Give the unit vector (n_pixel, k) that is nearest to normal to all rows of each pixel."""
    return np.linalg.eigh(per_pixel(rows[:, :, None] * rows[:, None, :], pixel, n_pixel))[1][..., 0]
