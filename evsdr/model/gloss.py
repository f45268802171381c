"""Gloss: a white specular lobe beside the Lambertian signal.

A_xj = R_xb max(0, n_x . l_xj) E_xj + k_x s(n_x, l_xj, v_x) E_xj,      E_xj = V g INT D E_j

The second term does not scale with the band reflectance, so `GlossyRing` gives the derivative by its
logarithm apart from the signal. Nothing here knows Mitsuba.
"""

from dataclasses import dataclass

import drjit as dr

from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing, seen_surface
from evsdr.model.rough import RoughRing

INDEX = 1.5  # of refraction of the coating


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
    WIDEST = 3.0  # of gloss, about as wide as the widest rough coating; wider lobes hardly differ from a matt surface
    RANGE = (WIDEST, 2000.0)

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
    WIDEST = 0.6  # as `BlinnPhong.WIDEST`
    RANGE = (0.02, WIDEST)

    def __call__(self, normal, light, view):
        """As `BlinnPhong.__call__`."""
        half = dr.normalize(light + view)
        value, gradient = facets(self.shape, normal, light, view, half)
        share = self.strength * fresnel(dr.dot(half, light))
        return share * value, share * gradient


def facets(alpha, normal, light, view, half):
    """Reflect by facets that are mirrors: pi D G / (4 n.v) of a roughness, and its gradient by the normal."""
    to_half, to_light, to_view = (dr.dot(normal, d) for d in (half, light, view))
    to_half, to_light, to_view = (dr.clip(c, 0.0, 1.0) for c in (to_half, to_light, to_view))
    square = dr.square(alpha)
    base = dr.square(to_half) * (square - 1.0) + 1.0
    density = 0.25 * square / dr.square(base)
    root_l, root_v = (
        dr.sqrt(dr.square(c) * (1.0 - square) + square) for c in (to_light, to_view)
    )  # n.x + root is 2 n.x / G1
    shadow_l, shadow_v = 2.0 * to_light / (to_light + root_l), 2.0 / (to_view + root_v)
    value = density * shadow_l * shadow_v
    by_half = value * 4.0 * to_half * (1.0 - square) / base
    by_light = density * shadow_v * 2.0 * square / (root_l * dr.square(to_light + root_l))
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
    roughness : Float, width 1, optional
        Of the matt part, see `rough.RoughRing`.
    """

    illumination: Illumination
    lobe: object
    view: object = None
    roughness: object = None

    def __call__(self, p, q, reflectance: list, softness):
        """Evaluate the model; arguments as those of `LambertianRing`.

        Returns
        -------
        signal, by_p, by_q, by_log_reflectance : list of Float, (n_led) of width n_pixel
            A_xj, dA/dp, dA/dq, and the derivative by the log reflectance of the LED's band: the diffuse part.
        """
        light = self.illumination
        matt = (
            LambertianRing(light) if self.roughness is None else RoughRing(light, self.roughness, self.view)
        )
        diffuse, by_p, by_q = matt(p, q, reflectance, softness)
        inv, normal, view = seen_surface(p, q, light, self.view)
        signal = []
        for j, (d, irradiance) in enumerate(zip(light.direction, light.irradiance)):
            value, gradient = self.lobe(normal, d, view)
            along = dr.dot(gradient, normal)
            signal.append(diffuse[j] + irradiance * value)
            by_p[j] += irradiance * inv * (along * normal.x - gradient.x)
            by_q[j] += irradiance * inv * (along * normal.y - gradient.y)
        return signal, by_p, by_q, diffuse
