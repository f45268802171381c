"""The signal model on Dr.Jit arrays: what each LED gives for a normal and a reflectance.

A_xj = R_xb max(0, n_x . l_xj) V_xj g_xj INT D E_j      (b: band of LED j)

Nothing here knows Mitsuba; arrays of any Dr.Jit backend will do.
"""

from dataclasses import dataclass

import drjit as dr
import numpy as np

from evsdr.model.arrays import columns
from evsdr.model.illumination import Illumination


def soft_max0(x, softness):
    """Shade by a smooth max(0, x) that stays positive, so that LEDs behind the horizon still pull.

    (x + sqrt(x^2 + softness^2)) / 2; softness 0 is the hard max(0, x).
    """
    return 0.5 * (x + dr.sqrt(dr.square(x) + dr.square(softness)))


def soft_max0_derivative(x, softness):
    """Derivative of `soft_max0` by x."""
    return 0.5 * (1.0 + x * dr.rsqrt(dr.square(x) + dr.square(softness)))


def seen_surface(p, q, illumination: Illumination, view=None):
    """Give 1 / |(-p, -q, 1)|, the unit normal of the slopes p and q, and the direction to the camera: `view`, or +z."""
    inv = dr.rsqrt(1.0 + p * p + q * q)
    Array3f = type(illumination.direction[0])
    return inv, Array3f(-p * inv, -q * inv, inv), Array3f(0, 0, 1) if view is None else view


def led_signals(illumination: Illumination, normal, reflectance: list) -> list:
    """Give the signal of each LED, without the constant light.

    Parameters
    ----------
    normal : Array3f, (n_pixel)
        Unit normals, camera frame.
    reflectance : list of Float, (n_band) of width n_pixel
        Band reflectance.

    Returns
    -------
    list of Float, (n_led) of width n_pixel
        A_xj. Differentiable in normal and reflectance.
    """
    direct = [
        reflectance[b] * irradiance * dr.maximum(dr.dot(normal, direction), 0.0)
        for direction, irradiance, b in zip(
            illumination.direction, illumination.irradiance, illumination.band
        )
    ]
    if illumination.indirect is None:
        return direct
    return [a + reflectance[b] * e for a, b, e in zip(direct, illumination.band, illumination.indirect)]


@dataclass(frozen=True)
class LambertianRing:
    """The forward model of the solver: signals of a ring with their derivatives by the slopes."""

    illumination: Illumination

    def __call__(self, p, q, reflectance: list, softness):
        """Evaluate the model.

        The normal is (-p, -q, 1) / sqrt(1 + p^2 + q^2), for p = dz/dx and q = dz/dy.

        Parameters
        ----------
        p, q : Float, (n_pixel)
            Slopes.
        reflectance : list of Float, (n_band) of width n_pixel
            Band reflectance. The derivative by its logarithm is the signal itself.
        softness : Float
            Width of the smooth horizon, see `soft_max0`; must be positive.

        Returns
        -------
        signal, by_p, by_q : list of Float, (n_led) of width n_pixel
            A_xj, dA/dp and dA/dq.
        """
        inv = dr.rsqrt(1.0 + p * p + q * q)
        nx, ny, nz = -p * inv, -q * inv, inv
        light = self.illumination
        signal, by_p, by_q = [], [], []
        for d, irradiance, b in zip(light.direction, light.irradiance, light.band):
            cosine = nx * d.x + ny * d.y + nz * d.z
            gain = reflectance[b] * irradiance
            slope = gain * soft_max0_derivative(cosine, softness) * inv
            signal.append(gain * soft_max0(cosine, softness))
            by_p.append(slope * (cosine * nx - d.x))
            by_q.append(slope * (cosine * ny - d.y))
        if light.indirect is not None:
            signal = [a + reflectance[b] * e for a, b, e in zip(signal, light.band, light.indirect)]
        return signal, by_p, by_q


def signals_of(model, theta: np.ndarray) -> np.ndarray:
    """Give the signals that a forward model predicts.

    Parameters
    ----------
    model : LambertianRing or GlossyRing
    theta : (n_pixel, 2 + n_band) float
        Slopes and log reflectances.

    Returns
    -------
    (n_led + 1, n_pixel) float64
        A_xj; the last row is darkness.
    """
    light = model.illumination
    Float = type(light.constant_light)
    p, q, *logs = columns(Float, theta)
    signal = model(p, q, [dr.exp(t) for t in logs], Float(light.horizon))[0]
    rows = [np.broadcast_to(s.numpy(), len(theta)) for s in signal]
    return np.stack([*rows, np.zeros(len(theta))])
