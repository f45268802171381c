"""Lobes in plain NumPy, and glossy spheres recorded with them."""

import mitsuba as mi
import numpy as np

from evsdr.events.pairs import pair_events
from evsdr.metrics import angular_error_deg
from evsdr.model.gloss import BlinnPhong, RoughCoating, fresnel
from evsdr.solve.problem import make_problem
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals
from tests.support.sphere import SPECTRUM, record_signal, ring_light

OTHER = SPECTRUM[::-1]
KINDS = [(BlinnPhong, 20.0, 0.3), (RoughCoating, 0.2, 0.8)]


def floats(*values):
    return [mi.Float(np.atleast_1d(v).astype(np.float32)) for v in values]


def vectors(array):
    return mi.Vector3f(np.ascontiguousarray(np.atleast_2d(array).T, np.float32))


def unit_vectors(rng, n, least_z=0.1):
    v = rng.normal(size=(n, 3))
    v[:, 2] = np.abs(v[:, 2]) + least_z
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def lobe_signals(kind, shape, strength, normal, direction):
    """The signals of a lobe (n_led, ...) in plain NumPy, seen along z."""
    half = direction + [0, 0, 1]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    nh, nl = (np.einsum("...k,jk->j...", normal, d) for d in (half, direction))
    if kind is BlinnPhong:
        return np.where(nl > 0, strength * np.maximum(nh, 0) ** shape, 0)

    def tan2(cosine):
        return 1 / np.clip(cosine, 1e-6, 1) ** 2 - 1

    c = half[:, 2].reshape(-1, *[1] * (normal.ndim - 1))
    inside = np.sqrt(1 - (1 - c**2) / 1.5**2)
    fresnel = 0.5 * (
        ((c - 1.5 * inside) / (c + 1.5 * inside)) ** 2 + ((1.5 * c - inside) / (1.5 * c + inside)) ** 2
    )
    nh = np.clip(nh, 0.01, 1)
    facets = 1 / (np.pi * shape**2 * nh**4 * (1 + tan2(nh) / shape**2) ** 2)
    shadow = [2 / (1 + np.sqrt(1 + shape**2 * tan2(x))) for x in (nl, normal[..., 2])]
    value = np.pi * strength * fresnel * facets * shadow[0] * shadow[1] / (4 * normal[..., 2].clip(1e-6))
    return np.where(nl > 0, value, 0)


def sphere(lobes=(), size=40, event_noise=0.1, seed=0, tilt=0.0, other=OTHER):
    """Give the solver's view of a recorded sphere, and its truth: normals, reflectances, left half.

    `lobes` are (kind, shape, strength), one for all or one for each half. Each pixel sees four matt facets, whose slopes
    lie `tilt` from its own.
    """
    normal, mask = sphere_normals(size)
    left = np.broadcast_to(np.arange(size) < size // 2, (size, size))
    reflectance = np.where(left[..., None] & (len(lobes) > 1), other, SPECTRUM)
    direction = ring_directions()
    signal = sum(lambert_signals(n, reflectance, direction) for n in facets(normal, tilt)) / 4
    for i, lobe in enumerate(lobes):
        where = left == (i == 1) if len(lobes) > 1 else True
        signal = signal + where * lobe_signals(*lobe, normal, direction)
    recording = record_signal(np.where(mask, signal, 0), seed, event_noise=event_noise)
    problem = make_problem(recording, pair_events(recording, mask), ring_light(), mask)
    return problem, normal[mask], reflectance[mask], left[mask]


def facets(normal, tilt):
    """Give four unit normals around each."""
    shifts = tilt * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    tilted = [normal + shift * normal[..., 2:] for shift in shifts]
    return [n / np.linalg.norm(n, axis=-1, keepdims=True).clip(1e-9) for n in tilted]


def mean_error(theta, normal):
    return angular_error_deg(np.column_stack([-theta[:, :2], np.ones(len(theta))]), normal).mean()


def metal_signals(roughness, reflectance, normal, direction):
    """The signals of metal (n_led, ...): the lobe of a coating without Fresnel's share, in the colour of the metal."""
    coating = lobe_signals(RoughCoating, roughness, 1.0, normal, direction)
    half = direction + [0, 0, 1]
    cosine = half[:, 2] / np.linalg.norm(half, axis=1)
    share = np.array(fresnel(mi.Float(cosine.astype(np.float32))))
    band = np.arange(len(direction)) % reflectance.shape[-1]
    coloured = np.moveaxis(reflectance[..., band], -1, 0)
    return coloured * coating / share.reshape(-1, *[1] * (normal.ndim - 1))


def metal_sphere(roughness, size=24, seed=0):
    """Give the solver's view of a recorded sphere of metal, and its true normals."""
    normal, mask = sphere_normals(size)
    reflectance = np.broadcast_to(SPECTRUM, (*mask.shape, 8))
    signal = metal_signals(roughness, reflectance, normal, ring_directions())
    recording = record_signal(np.where(mask, signal, 0), seed, event_noise=0.05)
    return make_problem(recording, pair_events(recording, mask), ring_light(), mask), normal[mask]
