"""What a ring of LEDs can tell, by closed formulas: design rule, gloss and shadow.

The equation numbers are those of EventSpecPS (Wu, Yu, Chan, Lam and Shi, ECCV 2026); S marks its supplement.
A light vector is the unit vector from surface to light times the irradiance g; its direction counts in the
camera frame (x right, y up, z toward the camera).
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

SMALLEST_SPREAD = 0.02  # singular value of unit vectors; two directions 1.6 degrees apart reach it
KNOWN_RATIO = 1e-3  # of singular values, from which a normal is known


# ---------------------------------------------------------------------- the design rule


@dataclass(frozen=True)
class RingReport:
    """What a ring and its schedule can identify at a pixel that no shadow reaches.

    Attributes
    ----------
    ratios : tuple of int, (n_band)
        Independent reflectance-free constraints of each band on the normal, 0 to 2; -1: never lit.
    normal_known : bool
        Whether normals can be told from reflectance.
    scale_known : bool
        Whether reflectance is absolute.
    degenerate_normal : (3,) float64 or None
        Normal of the surfaces that get equal light from all LEDs of each band; their scale stays unknown.
    problems : tuple of str
        One plain sentence for all that can't be identified, most severe first; empty for a ring that keeps
        the design rule and has no degenerate normal.
    """

    ratios: tuple[int, ...]
    normal_known: bool
    scale_known: bool
    degenerate_normal: np.ndarray | None
    problems: tuple[str, ...]


def check_ring(light: np.ndarray, band: np.ndarray, order: np.ndarray, constant_light: float) -> RingReport:
    """Check a ring against the design rule (Insights I and III).

    The rule: two independent pairs of directions in a band, that is three directions not in one plane; and
    each band visited in a round. Bands with two directions help each other. Since the scale has to come from
    the same ratios, the rank of all of them at a typical pixel decides; see `free_changes`.

    Parameters
    ----------
    light : (n_led, 3) float
        Light vectors g_j l_j.
    band : (n_led,) int
        Band of each LED, from 0.
    order : (n_slot,) int
        LED of each slot of a round, -1 for none.
    constant_light : float
        C_w.

    Returns
    -------
    RingReport
    """
    light, band, order = np.asarray(light, float), np.asarray(band), np.asarray(order)
    n_band, visited = band.max() + 1, np.unique(order[order >= 0])
    light, band = light[visited], band[visited]
    unit = light / np.linalg.norm(light, axis=-1, keepdims=True)
    rank = [_rank(unit[band == b]) for b in range(n_band)]
    lit_band = np.unique(band, return_inverse=True)[1]
    free = free_changes(light, lit_band, *_typical_pixel(unit, lit_band), constant_light)
    normal_known = bool(np.abs(free[:, :2]).max(initial=0) < KNOWN_RATIO)
    scale_known = constant_light > 0 and not len(free)
    degenerate = _degenerate_normal(light, band) if scale_known else None

    problems = []
    if _rank(unit) < 3:
        problems.append(
            "All LEDs lie in one plane with the object: any normal can turn along the great circle through "
            f"{_text(_least_seen(unit))} while reflectance makes up for it."
        )
    elif not normal_known:
        problems.append(
            "The LEDs give too few ratios to tell normals from reflectance; light more bands from three "
            "directions that are not in one plane."
        )
    for r, what in (
        (0, "never lit: nothing is known of the reflectance there."),
        (
            1,
            "lit from one direction only: reflectance there is known only where other bands give the normal.",
        ),
        (
            2,
            "lit by LEDs in one plane with the object: one ratio, which needs another band's for the normal.",
        ),
    ):
        bands = [str(b) for b in range(n_band) if rank[b] == r]
        if bands and not (r == 2 and _rank(unit) < 3):
            start = f"Band {bands[0]} is" if len(bands) == 1 else f"Bands {', '.join(bands)} are"
            problems.append(f"{start} {what}")
    if not constant_light > 0:
        problems.append("There is no constant light: reflectance is known up to one factor per pixel.")
    elif normal_known and not scale_known:
        problems.append("The LEDs give too few ratios for the scale of reflectance; add LEDs.")
    elif degenerate is not None:
        problems.append(
            f"A surface with normal {_text(degenerate)} gets equal light from all LEDs of each band "
            "(ratio 1): its scale stays unknown; tilt it, or make the ring less regular."
        )
    ratios = tuple(r - 1 for r in rank)
    return RingReport(ratios, normal_known, scale_known, degenerate, tuple(problems))


def free_changes(
    light: np.ndarray, band: np.ndarray, normal: np.ndarray, reflectance: np.ndarray, constant_light: float
) -> np.ndarray:
    """Find the small changes of a pixel's unknowns that change no ratio of its intensities (eq. 5, 7).

    Parameters
    ----------
    light : (n_led, 3) float
        Light vectors; LEDs behind the horizon give no light.
    band : (n_led,) int
        Band of each LED, from 0, none left out.
    normal : (3,) float
        Unit normal.
    reflectance : (n_band,) float
        Band reflectance, above 0.
    constant_light : float
        C_w; without it LEDs behind the horizon don't count.

    Returns
    -------
    (n_free, 2 + n_band) float64
        Orthonormal: turns of the normal about two axes, and changes of the log reflectances.
    """
    tangent = np.linalg.svd(normal[None])[2][1:]
    lit = light @ normal > 0
    signal = np.where(lit, light @ normal, 0) * reflectance[band]
    jacobian = np.zeros((len(light), 2 + len(reflectance)))
    jacobian[:, :2] = np.where(lit, reflectance[band], 0)[:, None] * (light @ tangent.T)
    jacobian[np.arange(len(light)), 2 + band] = signal
    counts = lit | (constant_light > 0)
    jacobian = jacobian[counts] / (signal + constant_light)[counts, None]
    _, value, direction = np.linalg.svd(jacobian - jacobian.mean(axis=0))
    return direction[np.sum(value > 1e-6 * value[0]) :]


def _typical_pixel(unit: np.ndarray, band: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give a normal that faces most LEDs and no symmetry of theirs, and reflectances that all differ."""
    normal = unit.sum(axis=0)
    normal = normal / max(np.linalg.norm(normal), 1e-9) + [0.037, -0.061, 0.02]
    reflectance = 0.2 + 0.6 * (0.618 * np.arange(1, band.max() + 2) % 1)
    return normal / np.linalg.norm(normal), reflectance


def _rank(unit: np.ndarray) -> int:
    """Count the dimensions that directions (n, 3) span."""
    return int(np.sum(np.linalg.svd(unit, compute_uv=False) > SMALLEST_SPREAD)) if len(unit) else 0


def _least_seen(vectors: np.ndarray) -> np.ndarray:
    """Give the direction (3,) that vectors (n, 3) span least; its largest component is positive."""
    direction = np.linalg.svd(vectors)[2][-1]
    return direction * np.sign(direction[np.abs(direction).argmax()])


def _degenerate_normal(light: np.ndarray, band: np.ndarray) -> np.ndarray | None:
    """Find n with g_i l_i . n = g_j l_j . n for all pairs of each band, if there is one that is lit."""
    pairs = [(i, j) for i, j in combinations(range(len(band)), 2) if band[i] == band[j]]
    difference = np.array([light[i] - light[j] for i, j in pairs]) / np.linalg.norm(light, axis=-1).max()
    normal = _least_seen(difference)
    normal = normal * np.sign(light.sum(axis=0) @ normal)
    is_equal = np.abs(difference @ normal).max() < SMALLEST_SPREAD
    return normal if is_equal and (light @ normal > 0).all() else None


def _text(v: np.ndarray) -> str:
    return "(" + ", ".join(f"{c:.2f}" for c in np.round(v, 2) + 0.0) + ")"  # + 0.0: no -0.00


# ---------------------------------------------------------------------- gloss and attached shadow


def polar_angle_range(shininess: float, threshold: float) -> tuple[float, float] | None:
    """Give the polar angles [deg] for which the paper proves a clean observation in each band (S 14, 23).

    Far LEDs, three per band, 120 degrees apart. An observation is clean if it is not in attached shadow and
    its Blinn-Phong response (n . h)^m stays below the threshold. Any range inside is safe; the largest is
    `exact_polar_angle_range`.

    Parameters
    ----------
    shininess : float
        m, above 0.
    threshold : float
        tau, 0 < tau <= 1, of the normalised response.

    Returns
    -------
    (float, float) or None
        Between 0 and 70.53 degrees; None if the range is empty: the gloss is too wide.
    """
    sine = np.sin(_cap_angle(shininess, threshold))
    if sine >= np.sqrt(3) / 2:
        return None
    low = 2 * np.arcsin(2 / np.sqrt(3) * sine)
    c = max(root.real for root in np.roots([3, 0, -2, -sine]) if abs(root.imag) < 1e-9)  # S 22
    return _degrees(low, 2 * np.arccos(c))


def exact_polar_angle_range(shininess: float, threshold: float) -> tuple[float, float] | None:
    """Give all polar angles [deg] at which each visible normal keeps a clean observation in each band.

    Arguments and results as in `polar_angle_range`. Below, the normal toward the camera lies in the glossy
    caps of all three LEDs: theta = 2 gamma. Above, the far end of a cap lies in the attached shadow of both
    other LEDs: tan(theta / 2 + gamma) tan(theta) = 2, a cubic in tan(theta / 2).
    """
    gamma = _cap_angle(shininess, threshold)
    g = np.tan(gamma)
    high = 2 * np.arctan(
        min(root.real for root in np.roots([g, -2, -2 * g, 1]) if abs(root.imag) < 1e-9 and root.real > 0)
    )
    return _degrees(2 * gamma, high)


def _cap_angle(shininess: float, threshold: float) -> float:
    """Give gamma, the angular radius of a glossy cap [rad] (S 10)."""
    return float(np.arccos(threshold ** (1 / shininess)))


def _degrees(low: float, high: float) -> tuple[float, float] | None:
    return (float(np.degrees(low)), float(np.degrees(high))) if low < high else None


def hemisphere_normals(n: int) -> np.ndarray:
    """Spread n unit normals (n, 3) evenly over the visible hemisphere, n_z from 1 to 0 (Fibonacci spiral)."""
    z = np.linspace(1, 0, n)
    azimuth = np.pi * (3 - np.sqrt(5)) * np.arange(n)
    radius = np.sqrt(1 - z**2)
    return np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z])


def clean_observations(
    normal: np.ndarray, light: np.ndarray, band: np.ndarray, shininess: float, threshold: float
) -> np.ndarray:
    """Count the LEDs of each band that a normal sees neither in attached shadow (S 6) nor as gloss (S 9).

    Parameters
    ----------
    normal : (n_normal, 3) float
        Unit normals.
    light : (n_led, 3) float
        Light vectors; the camera looks from z.
    band : (n_led,) int
        Band of each LED, from 0.

    Returns
    -------
    (n_normal, n_band) int
    """
    unit = light / np.linalg.norm(light, axis=-1, keepdims=True)
    half = unit + [0, 0, 1]
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    clean = (normal @ unit.T > 0) & (np.maximum(normal @ half.T, 0) ** shininess < threshold)
    return np.stack([clean[:, band == b].sum(axis=1) for b in range(band.max() + 1)], axis=-1)
