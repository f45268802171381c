"""Gloss: a white specular lobe beside the Lambertian signal; angular gate and robust width do without.

A_xj = R_xb max(0, n_x . l_xj) E_xj + k_x s(n_x, l_xj, v_x) E_xj,      E_xj = V g INT D E_j

The second term does not scale with the band reflectance, so `GlossyRing` gives the derivative by its
logarithm apart from the signal. Nothing here knows Mitsuba.
"""

from dataclasses import dataclass

import drjit as dr
import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import t as student

from evsdr.adam import GATE_DEG
from evsdr.event_terms import PairData, ends, relative_residual, signal_table
from evsdr.shading import Illumination, LambertianRing

INDEX = 1.5  # of refraction of the coating
GATE_FLOOR = 0.1  # weight of a pair on the half vector itself
DEGREES_OF_FREEDOM = (1.0, 300.0)  # of Student's t; the last is Gaussian for all purposes


# ---------------------------------------------------------------------- lobes


@dataclass(frozen=True)
class BlinnPhong:
    """k (n . h)^m, for a lit surface (EventSpecPS supplement, eq. 7).

    Attributes
    ----------
    shape : Float, width 1 or n_pixel
        m, shininess.
    strength : Float, width 1 or n_pixel
        k, in the unit of band reflectance.
    """

    shape: object
    strength: object

    STARTS = (8.0, 32.0, 128.0)  # shapes to start a search from
    RANGE = (1.0, 2000.0)

    def __call__(self, normal, light, view):
        """Give the lobe and its gradient by the normal.

        Parameters
        ----------
        normal, light, view : Array3f
            Unit vectors.

        Returns
        -------
        value : Float
        gradient : Array3f
            The normal's length is left free.
        """
        half = dr.normalize(light + view)
        cosine = dr.maximum(dr.dot(normal, half), 1e-3)
        lit = dr.dot(normal, light) > 0
        value = dr.select(lit, self.strength * dr.exp(self.shape * dr.log(cosine)), 0.0)
        return value, (self.shape * value / cosine) * half


@dataclass(frozen=True)
class RoughCoating:
    """k times the reflection of a rough dielectric of index 1.5.

    Trowbridge-Reitz facets, Smith's shadowing, Fresnel: D F G / (4 n.v n.l), times n.l and, for the unit of
    signals, pi. Walter et al., "Microfacet models for refraction through rough surfaces", EGSR 2007,
    eqs. 20, 22, 33, 34. A clean coating has k = 1.

    Attributes
    ----------
    shape : Float, width 1 or n_pixel
        alpha, roughness.
    strength : Float, width 1 or n_pixel
        k.
    """

    shape: object
    strength: object

    STARTS = (0.08, 0.16, 0.32)
    RANGE = (0.02, 0.8)

    def __call__(self, normal, light, view):
        """As `BlinnPhong.__call__`."""
        half = dr.normalize(light + view)
        to_half, to_light, to_view = (dr.dot(normal, d) for d in (half, light, view))
        to_half, to_light, to_view = (dr.clip(c, 0.0, 1.0) for c in (to_half, to_light, to_view))
        square = dr.square(self.shape)
        base = dr.square(to_half) * (square - 1.0) + 1.0
        facets = 0.25 * square * self.strength * fresnel(dr.dot(half, light)) / dr.square(base)
        root_l, root_v = (
            dr.sqrt(dr.square(c) * (1.0 - square) + square) for c in (to_light, to_view)
        )  # n.x + root is 2 n.x / G1
        shadow_l, shadow_v = 2.0 * to_light / (to_light + root_l), 2.0 / (to_view + root_v)
        value = facets * shadow_l * shadow_v
        by_half = value * 4.0 * to_half * (1.0 - square) / base
        by_light = facets * shadow_v * 2.0 * square / (root_l * dr.square(to_light + root_l))
        by_view = -0.5 * value * shadow_v * (1.0 + to_view * (1.0 - square) / root_v)
        lit = to_light > 0
        gradient = by_half * half + by_light * light + by_view * view
        return dr.select(lit, value, 0.0), dr.select(lit, gradient, 0.0)


def fresnel(cosine, index: float = INDEX):
    """Give the unpolarised reflectance of a dielectric, for the cosine of the angle of incidence."""
    inner = dr.sqrt(index**2 - 1.0 + dr.square(cosine))
    parallel = (index**2 * cosine - inner) / (index**2 * cosine + inner)
    return 0.5 * (dr.square((cosine - inner) / (cosine + inner)) + dr.square(parallel))


# ---------------------------------------------------------------------- forward model


@dataclass(frozen=True)
class GlossyRing:
    """The forward model of a glossy surface, for the solver: `shading.LambertianRing` and a lobe.

    Attributes
    ----------
    illumination : Illumination
    lobe : BlinnPhong or RoughCoating
    view : Array3f, width 1 or n_pixel, optional
        Unit vectors from surface to camera, camera frame; None is the axis of an orthographic camera.
    """

    illumination: Illumination
    lobe: object
    view: object = None

    def __call__(self, p, q, reflectance: list, softness):
        """Evaluate the model; arguments as those of `LambertianRing`.

        Returns
        -------
        signal, by_p, by_q, by_log_reflectance : list of Float, (n_led) of width n_pixel
            A_xj, dA/dp, dA/dq, and the derivative by the log reflectance of the LED's band: the diffuse part.
        """
        diffuse, by_p, by_q = LambertianRing(self.illumination)(p, q, reflectance, softness)
        inv = dr.rsqrt(1.0 + p * p + q * q)
        Array3f = type(self.illumination.direction[0])
        normal = Array3f(-p * inv, -q * inv, inv)
        view = Array3f(0, 0, 1) if self.view is None else self.view
        signal = []
        for j, (d, irradiance) in enumerate(zip(self.illumination.direction, self.illumination.irradiance)):
            value, gradient = self.lobe(normal, d, view)
            along = dr.dot(gradient, normal)
            signal.append(diffuse[j] + irradiance * value)
            by_p[j] += irradiance * inv * (along * normal.x - gradient.x)
            by_q[j] += irradiance * inv * (along * normal.y - gradient.y)
        return signal, by_p, by_q, diffuse


# ---------------------------------------------------------------------- without a lobe: gate and robust width


def gate_weights(
    illumination: Illumination, normal, view=None, gate_deg: float = GATE_DEG, floor: float = GATE_FLOOR
) -> list:
    """Give the weight of each LED in each pixel: low where the normal is near the LED's half vector.

    The angular gate of EventSpecPS (section 5.1), which leaves its form open: here, of the angle a,
    1 - (1 - floor) exp(-(a / gate)^2).

    Parameters
    ----------
    normal : Array3f, (n_pixel)
        Unit normals as known so far.

    Returns
    -------
    list of Float, (n_led) of width n_pixel
    """
    view = type(normal)(0, 0, 1) if view is None else view
    weights = []
    for d in illumination.direction:
        angle = dr.acos(dr.clip(dr.dot(normal, dr.normalize(d + view)), -1.0, 1.0))
        weights.append(1.0 - (1.0 - floor) * dr.exp(-dr.square(angle / float(np.radians(gate_deg)))))
    return weights


def pair_weights(pairs: PairData, weights: list):
    """Turn weights of (LED, pixel) into weights of event pairs: the product of those of both ends.

    Returns
    -------
    Float, (n_pair)
    """
    table = signal_table([1.0 - w for w in weights], dr.width(pairs.threshold_on))
    start, end, _ = ends(table, pairs, *_every_pair(pairs), True)
    return (1.0 - start) * (1.0 - end)


def pair_residuals(model, pairs: PairData, constant_light, theta: np.ndarray) -> np.ndarray:
    """Give the relative residual of every pair (n_pair).

    Parameters
    ----------
    model : callable
        Forward model.
    theta : (n_pixel, 2 + n_band) float
        Slopes and log reflectances.
    """
    Float = type(pairs.phases)
    p, q, *log_reflectance = (Float(np.ascontiguousarray(column, np.float32)) for column in theta.T)
    signal, *_ = model(
        p, q, [dr.exp(t) for t in log_reflectance], dr.opaque(Float, model.illumination.horizon)
    )
    table = signal_table(signal, len(theta))
    return relative_residual(table, pairs, constant_light, *_every_pair(pairs), True)[0].numpy()


def _every_pair(pairs: PairData):
    """Give the number of every pair, its pixel, and the number of pixels."""
    UInt32 = type(pairs.offset)
    count = np.diff(pairs.offset.numpy())
    pixel = UInt32(np.repeat(np.arange(len(count), dtype=np.uint32), count))
    return dr.arange(UInt32, dr.width(pixel)), pixel, dr.opaque(UInt32, len(count))


def robust_width(residual: np.ndarray) -> float:
    """Give the width of the Cauchy cost that the distribution of residuals asks for [standard deviations].

    Student's t of nu degrees of freedom and scale s, fitted by maximum likelihood, weighs a residual by
    1 / (1 + u^2 / (nu s^2)), up to a factor: as Cauchy's cost with a width of s sqrt(nu).

    Parameters
    ----------
    residual : (n,) float
        Relative residuals of event pairs, of any scale; their standard deviation is told by the median.
    """
    middle = np.median(np.abs(residual))

    def scale(freedom):
        return middle / student.ppf(0.75, freedom)  # has the same median

    def cost(log_freedom):
        freedom = np.exp(log_freedom)
        return -np.mean(student.logpdf(residual, freedom, scale=scale(freedom)))

    found = minimize_scalar(cost, bounds=np.log(DEGREES_OF_FREEDOM), method="bounded")
    freedom = float(np.exp(found.x))
    return float(np.sqrt(freedom) * scale(freedom) / (1.4826 * middle))
