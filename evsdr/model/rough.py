"""Matt surfaces that are rough: brighter than Lambert's where light or view graze, or darker where they are smooth.

A_xj = R_xb max(0, n_x . l_xj) f(n_x . l_xj, n_x . v_x, l_xj . v_x; r) E_xj,      E_xj = V g INT D E_j

    f = (1 - F_l / 2) (1 - F_v / 2) + S (F_l + F_v + F_l F_v (S - 1)),      S = 2 r cos^2 d,      F_x = (1 - n . x)^5,

d half the angle between light and view (Burley, "Extending the Disney BRDF to a BSDF with integrated subsurface scattering", SIGGRAPH
course 2015, eqs. 4 and 5; fitted to measured materials, cloth and other sheen included). Nothing here knows Mitsuba.
"""

from dataclasses import dataclass, replace

import drjit as dr

from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing, seen_surface


@dataclass(frozen=True)
class RoughRing:
    """The forward model of a rough matt surface, for the solver.

    Attributes
    ----------
    illumination : Illumination
    roughness : Float, width 1
        r.
    view : Array3f, width 1 or n_pixel, optional
        See `gloss.GlossyRing`.
    """

    illumination: Illumination
    roughness: object
    view: object = None

    def __call__(self, p, q, reflectance: list, softness):
        """Evaluate the model; arguments and results as those of `LambertianRing`."""
        light = self.illumination
        signal, by_p, by_q = LambertianRing(replace(light, indirect=None))(p, q, reflectance, softness)
        inv, normal, view = seen_surface(p, q, light, self.view)
        to_view = dr.dot(normal, view)
        for j, d in enumerate(light.direction):
            to_light = dr.dot(normal, d)
            value, by_light, by_view = burley(to_light, to_view, dr.dot(d, view), self.roughness)
            lambert = signal[j]
            signal[j] = lambert * value
            for by, axis, slope in ((by_p, 0, normal.x), (by_q, 1, normal.y)):
                turn = by_light * (to_light * slope - d[axis]) + by_view * (to_view * slope - view[axis])
                by[j] = by[j] * value + lambert * inv * turn
        if light.indirect is not None:
            signal = [a + reflectance[b] * e for a, b, e in zip(signal, light.band, light.indirect)]
        return signal, by_p, by_q


def burley(to_light, to_view, between, roughness):
    """Give f, and its derivatives by n . l and n . v, of the cosines n . l, n . v, l . v."""
    strength = roughness * (1.0 + between)
    light, view = (1.0 - dr.clip(c, 0.0, 1.0) for c in (to_light, to_view))
    of_light, of_view = (dr.square(dr.square(c)) * c for c in (light, view))
    more = strength * (strength - 1.0) + 0.25  # of the product of both
    part = strength - 0.5
    value = 1.0 + part * (of_light + of_view) + more * of_light * of_view
    by_light, by_view = (
        dr.select(c > 0, -5.0 * dr.square(dr.square(1.0 - c)) * (part + more * other), 0.0)
        for c, other in ((to_light, of_view), (to_view, of_light))
    )
    return value, by_light, by_view
