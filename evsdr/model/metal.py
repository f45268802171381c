"""Metal: no matt part, and a lobe that has the colour.

A_xj = R_xb f(n_x, l_xj, v_x; alpha) E_xj,      E_xj = V g INT D E_j

f is that of facets that are mirrors, see `gloss.facets`; R_xb is what they reflect at the angle at which they are met. Nothing here
knows Mitsuba.
"""

from dataclasses import dataclass

import drjit as dr

from evsdr.model.gloss import facets
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import seen_surface

OF_SOFTNESS = (
    1.5  # roughness by a softness of 1: normals that are spread by s have a roughness of about 2^0.5 s
)


@dataclass(frozen=True)
class MetalRing:
    """The forward model of metal, for the solver.

    Attributes
    ----------
    illumination : Illumination
    roughness : Float, width 1 or n_pixel
        alpha.
    view : Array3f, width 1 or n_pixel, optional
        See `gloss.GlossyRing`.
    """

    illumination: Illumination
    roughness: object
    view: object = None

    def __call__(self, p, q, reflectance: list, softness):
        """Evaluate the model; arguments and results as those of `LambertianRing`.

        Where matt surfaces have a soft horizon metal is rougher: normals are spread within a pixel.
        """
        light = self.illumination
        inv, normal, view = seen_surface(p, q, light, self.view)
        alpha = dr.sqrt(dr.square(self.roughness) + dr.square(OF_SOFTNESS * softness))
        alpha = dr.minimum(alpha, 1.0)
        signal, by_p, by_q = [], [], []
        for d, irradiance, b in zip(light.direction, light.irradiance, light.band):
            value, gradient = facets(alpha, normal, d, view, dr.normalize(d + view))
            gain = reflectance[b] * irradiance
            along = dr.dot(gradient, normal)
            signal.append(gain * value)
            by_p.append(gain * inv * (along * normal.x - gradient.x))
            by_q.append(gain * inv * (along * normal.y - gradient.y))
        return signal, by_p, by_q

    def twin(self, theta: list) -> list:
        """Give other unknowns whose light looks nearly alike, where LEDs form a ring.

        Far from a half vector h facets reflect with sin(theta/2)^-4, theta the angle to the normal. In stereographic coordinates
        about the ring's axis, u of the normal and v of h, that is ((1 + u^2) (1 + v^2) / |u - v|^2)^2: normals at u and v^2 / u
        give the same signals but for a factor, which their reflectances can have.
        """
        light = self.illumination
        p, q = theta[:2]
        _, normal, view = seen_surface(p, q, light, self.view)
        halves = [dr.normalize(d + view) for d in light.direction]
        axis = dr.normalize(sum(halves))
        cosine = sum(dr.dot(h, axis) for h in halves) / len(halves)
        square = (1 - cosine) / (1 + cosine)  # of v
        along = dr.dot(normal, axis)
        sideways = normal - along * axis
        length = dr.maximum(dr.norm(sideways), 1e-3)
        u = length / (1 + dr.maximum(along, -0.9))
        other = square / u
        there = (2 * other * sideways / length + (1 - dr.square(other)) * axis) / (1 + dr.square(other))
        nz = dr.maximum(there.z, 0.05)
        change = 2 * dr.log((other * (1 + dr.square(u))) / (u * (1 + dr.square(other))))
        n_band = light.n_band
        return [
            -there.x / nz,
            -there.y / nz,
            *(t + change for t in theta[2 : 2 + n_band]),
            *theta[2 + n_band :],
        ]
