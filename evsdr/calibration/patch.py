"""Relative LED powers and the constant light from a white patch at several tilts.

A flat patch of known reflectance R and normal n gives A_j = R e_j max(0, n . l_j) g_j, the same C_w for every
tilt. Events tell ratios of (A_j + C_w) only: one tilt has one ratio too few for 24 powers and C_w, two tilts
have enough. Powers and C_w share one unit, which events can't tell: the mean power is that of the scene file.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evsdr.calibration.equations import Estimate, fit_events
from evsdr.calibration.watched import Watched
from evsdr.errors import InputError
from evsdr.progress import Progress, silent

VAGUE = 0.5  # relative standard deviation of C_w from which it counts as unknown
WIDEST = 20.0  # of the logarithm of a power over C_w
LEAST_SIGMA_DEG = 1e-3  # of a tilt: it is never exact


@dataclass(frozen=True)
class Patch:
    """One tilt of the patch: what its points would give if all powers were 1.

    Attributes
    ----------
    normal : (3,) float
        Unit vector, camera frame.
    direction : (n_led, n_point, 3) float
        Unit vectors to the LEDs, camera frame.
    gain : (n_led, n_point) float
        R g: reflectance in the LED's band times fall-off.
    """

    normal: np.ndarray
    direction: np.ndarray
    gain: np.ndarray


@dataclass(frozen=True)
class Powers:
    """What the tilts tell.

    Attributes
    ----------
    power, power_sigma : (n_led,) float
        INT D E_j, in the unit in which their mean is that of the scene file.
    constant_light, constant_light_sigma : float
        C_w in that unit.
    normal : (n_patch, 3) float
        Tilts as refined, camera frame.
    tilt_change_deg, tilt_sigma_deg : (n_patch,) float
        How far they moved, and their standard deviation [deg].
    solution : Estimate
    """

    power: np.ndarray
    power_sigma: np.ndarray
    constant_light: float
    constant_light_sigma: float
    normal: np.ndarray
    tilt_change_deg: np.ndarray
    tilt_sigma_deg: np.ndarray
    solution: Estimate


def patch_model(patches: list[Patch]):
    """Give the model: each LED has the logarithm of its power over C_w; shared are two tilts per patch."""
    axes = [_tangents(patch.normal) for patch in patches]

    def model(x):
        n_led = len(x) - 2 * len(patches)
        power, tilt = np.exp(np.clip(x[:n_led], -WIDEST, WIDEST)), x[n_led:].reshape(-1, 2)
        value, shared = [], []
        for k, (patch, axis) in enumerate(zip(patches, axes)):
            normal, by_tilt = tilted(patch.normal, axis, tilt[k])
            cosine = patch.direction @ normal
            gain = patch.gain * power[:, None] * (cosine > 0)
            value.append(gain * cosine)
            part = np.zeros((*gain.shape, tilt.size))
            part[..., 2 * k : 2 * k + 2] = gain[..., None] * (patch.direction @ by_tilt.T)
            shared.append(part)
        value = np.concatenate(value, axis=1)
        return value, value[..., None], np.concatenate(shared, axis=1)

    return model


def _tangents(normal: np.ndarray) -> np.ndarray:
    """Give two unit vectors (2, 3) across a normal."""
    helper = np.eye(3)[np.abs(normal).argmin()]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def tilted(normal: np.ndarray, axes: np.ndarray, tilt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give the normal (3,) after a small tilt (2,) [rad], and its derivatives (2, 3)."""
    v = normal + tilt @ axes
    length = np.linalg.norm(v)
    unit = v / length
    return unit, (axes - np.outer(axes @ unit, unit)) / length


def solve_powers(
    patches: list[Patch],
    parts: Sequence[Watched],
    start: np.ndarray,
    start_light: float,
    tilt_sigma_deg: float,
    progress: Progress = silent,
) -> Powers:
    """Find powers and constant light.

    Parameters
    ----------
    patches : list of Patch
    parts : sequence of Watched
        Their points count through the points of all patches.
    start : (n_led,) float
        Powers as the scene file has them; their mean sets the unit.
    start_light : float
        Constant light to start from.
    tilt_sigma_deg : float
        Standard deviation of the given tilts, for each of two axes [deg].
    progress : callable (detail, share), optional
        Told how far it is.

    Raises
    ------
    InputError
        Some LED lights no tilt, or the tilts don't tell powers from constant light.
    """
    n_led, n_patch = len(start), len(patches)
    lit = sum(np.max(p.gain * np.maximum(p.direction @ p.normal, 0), axis=1) for p in patches)
    seen = np.isin(np.arange(n_led), np.concatenate([part.order for part in parts]))
    if not (lit > 0).all() or not seen.all():
        j = int(np.flatnonzero((lit <= 0) | ~seen)[0])
        raise InputError(f"no tilt shows LED {j} to the patch; add one that faces it, or light it in order.")
    mean = start.mean()
    sigma = np.radians(max(tilt_sigma_deg, LEAST_SIGMA_DEG))
    prior = np.append(np.full(n_led, np.inf), np.full(2 * n_patch, sigma))
    x = np.append(np.log(start / max(start_light, 1e-3 * mean)), np.zeros(2 * n_patch))
    found = fit_events(parts, patch_model(patches), x, prior, progress=progress)
    ratio = np.exp(np.clip(found.x[:n_led], -WIDEST, WIDEST))
    cov = found.covariance[:n_led, :n_led]
    share = ratio / ratio.sum()
    light_sigma = np.sqrt(max(share @ cov @ share, 0))  # of log C_w, as C_w = mean power / mean ratio
    if found.condition > 1e9 or not light_sigma < VAGUE:
        raise InputError(
            "the tilts don't tell the powers of the LEDs from the constant light; "
            "record the patch at two tilts at least, 15 degrees or more apart, or with a dark slot (-1 in "
            "order)."
        )
    relative = np.eye(n_led) - share  # d log power_j / d x
    tilts = found.x[n_led:].reshape(n_patch, 2)
    normal = np.array([tilted(p.normal, _tangents(p.normal), t)[0] for p, t in zip(patches, tilts)])
    power = mean * ratio / ratio.mean()
    variance = np.diagonal(found.covariance)[n_led:].reshape(n_patch, 2).sum(axis=1)
    return Powers(
        power=power,
        power_sigma=power * np.sqrt(np.maximum(np.einsum("ja,ab,jb->j", relative, cov, relative), 0)),
        constant_light=float(mean / ratio.mean()),
        constant_light_sigma=float(mean / ratio.mean() * light_sigma),
        normal=normal,
        tilt_change_deg=np.degrees(np.linalg.norm(tilts, axis=1)),
        tilt_sigma_deg=np.degrees(np.sqrt(variance)),
        solution=found,
    )
