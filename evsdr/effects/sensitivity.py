"""How far normals move if something is left out of the signal model: the measure of every decision.

A fit that leaves out a change d of the signals explains it as well as it can by other normals and reflectances. To
first order these move by the least squares solution of J x = log((A + d + C_w) / (A + C_w)), with J the derivatives
of log (A + C_w) by the direction of the normal and the log reflectances: what event pairs compare.
"""

from dataclasses import dataclass

import drjit as dr
import numpy as np

from evsdr.light.ground_truth import object_depth, object_normals
from evsdr.light.scene import RingScene
from evsdr.model.arrays import columns, owned
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import led_signals
from evsdr.records import Maps
from evsdr.solve.unknowns import REFLECTANCE_CENTRE

RIDGE = 1e-3  # keeps pixels solvable that few LEDs light
MOST_DEG = 60.0  # no answer of first order means more
SHARE = 2000  # pixels that are asked


def expected_error_deg(
    normal: np.ndarray,
    reflectance: np.ndarray,
    direction: np.ndarray,
    irradiance: np.ndarray,
    band: list[int],
    constant_light: float,
    change: np.ndarray,
) -> np.ndarray:
    """Give the angle by which each normal moves if signals change but the model does not.

    Parameters
    ----------
    normal : (n_pixel, 3) float
        Unit normals, camera frame.
    reflectance : (n_pixel, n_band) float
    direction : (n_led, n_pixel or 1, 3) float
        Unit vectors from surface to light.
    irradiance : (n_led, n_pixel or 1) float
        V g INT D E_j, as the model has them.
    band : (n_led) list of int
    constant_light : float
        C_w, above 0.
    change : (n_pixel, n_led) float
        What the signals really have in addition.

    Returns
    -------
    (n_pixel,) float
        Degrees, 60 at most.
    """
    n_band = reflectance.shape[1]
    direction = np.broadcast_to(direction, (len(band), len(normal), 3))
    irradiance = np.broadcast_to(irradiance, (len(band), len(normal)))
    brightest = reflectance[:, band] * irradiance.T  # signals of patches that face the LEDs
    signal = brightest * np.maximum(np.einsum("jnk,nk->nj", direction, normal), 0)
    level = signal + constant_light
    residual = np.log(np.maximum(level + change, constant_light) / level)
    first = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.7, (1.0, 0, 0), (0, 1.0, 0)))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    jacobian = np.zeros((*signal.shape, 2 + n_band))
    gain = brightest * (signal > 0) / level
    for k, tangent in enumerate((first, second)):
        jacobian[..., k] = gain * np.einsum("jnk,nk->nj", direction, tangent)
    jacobian[:, np.arange(len(band)), 2 + np.asarray(band)] = signal / level
    matrix = np.einsum("nji,njk->nik", jacobian, jacobian) + RIDGE * np.eye(2 + n_band)
    right = np.einsum("nji,nj->ni", jacobian, residual)
    moved = np.linalg.solve(matrix, right[..., None])[:, :2, 0]
    return np.minimum(np.degrees(np.linalg.norm(moved, axis=1)), MOST_DEG)


@dataclass(frozen=True)
class Look:
    """Some pixels with their normals (n, 3) and reflectances (n, n_band): what decisions are made on."""

    pixel: np.ndarray
    normal: np.ndarray
    reflectance: np.ndarray

    def light(self, light: Illumination) -> tuple[np.ndarray, np.ndarray]:
        """Give directions (n_led, n, 3) and irradiances (n_led, n) of a light there."""

        def at(values):
            values = np.asarray(values, float)
            return np.broadcast_to(values, (len(self.pixel),)) if values.size == 1 else values[self.pixel]

        direction = [np.stack([at(d[k].numpy()) for k in range(3)], axis=-1) for d in light.direction]
        return np.array(direction), np.array([at(e.numpy()) for e in light.irradiance])

    def signals(self, light: Illumination) -> np.ndarray:
        """Give the signals (n, n_led) of a light there, indirect light included."""
        Float, Array3f = type(light.constant_light), type(light.direction[0])
        normal = Array3f(*columns(Float, self.normal))
        reflectance = columns(Float, self.reflectance)
        here = light.gather(owned(dr.uint32_array_t(Float), self.pixel))
        rows = [s.numpy() for s in led_signals(here, normal, reflectance)]
        return np.stack([np.broadcast_to(row, len(self.pixel)) for row in rows], axis=-1).astype(float)


def look_at(maps: Maps) -> Look:
    """Look at what was fitted."""
    pixel = _some_of(np.flatnonzero(maps.mask))
    normal, reflectance = (v.reshape(-1, v.shape[-1])[pixel] for v in (maps.normal, maps.reflectance))
    return Look(pixel, normal.astype(float), reflectance.astype(float))


def look_at_geometry(ring: RingScene, mask: np.ndarray) -> Look:
    """Look at the scene's geometry, with reflectances that are not yet known."""
    pixel = _some_of(np.flatnonzero(mask & (object_depth(ring) > 0)))
    normal = object_normals(ring).reshape(-1, 3)[pixel]
    return Look(pixel, normal, np.full((len(pixel), ring.leds.n_band), REFLECTANCE_CENTRE))


def mean_error(look: Look, model: Illumination, real: Illumination) -> float:
    """Give the mean expected error of the normals [deg] if the light is `real` but `model` is fitted."""
    if len(look.pixel) == 0:
        return 0.0
    there = look.signals(real)
    constant = max(float(model.constant_light[0]), 1e-3 * np.max(there), 1e-9)
    change = there - look.signals(model)
    given = look.normal, look.reflectance, *look.light(model), model.band
    return float(expected_error_deg(*given, constant, change).mean())


def against(error: float, modelled: bool, limit: float) -> str:
    """Compare an expected error with its limit."""
    turn = f"left out, that turns normals by {error:.2g} degrees"
    return f"{turn}, {'more' if modelled else 'less'} than {limit:g}"


def _some_of(pixel: np.ndarray) -> np.ndarray:
    """Choose at most `SHARE` pixels, evenly."""
    n = len(pixel)
    return pixel[np.unique(np.linspace(0, n - 1, min(n, SHARE)).round().astype(int))] if n else pixel
