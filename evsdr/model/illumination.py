"""What the LEDs send to each pixel, and how soft their horizon is."""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.model.arrays import owned

HARD = 1e-3  # softness of a horizon that is hard for all purposes
OF_SPREAD = 0.8  # softness of a horizon over which n . l is spread, see `pixel_horizon`


@dataclass(frozen=True)
class Illumination:
    """What the LEDs send to each pixel.

    Attributes
    ----------
    direction : list of Array3f, (n_led) of width 1 or n_pixel
        Unit vectors from surface to light, camera frame; width 1 for far LEDs.
    irradiance : list of Float, (n_led) of width 1 or n_pixel
        V g INT D E_j; 0 in cast shadow.
    band : list of int, (n_led)
        Band of each LED.
    constant_light : Float
        C_w.
    indirect : list of Float, (n_led) of width n_pixel, optional
        What each LED sends by way of other surfaces, in the unit of the irradiance; whatever the pixel's normal.
    spread : float
        Standard deviation of the direction over the surface of an LED [rad]; 0 for points.
    """

    direction: list
    irradiance: list
    band: list
    constant_light: object
    indirect: list | None = None
    spread: float = 0.0

    @property
    def horizon(self) -> float:
        """Softness of the horizon (see `soft_max0`) behind which LEDs set: hard for all purposes if they are points."""
        return max(HARD, OF_SPREAD * self.spread)

    @property
    def n_led(self) -> int:
        return len(self.band)

    @property
    def n_band(self) -> int:
        return max(self.band) + 1

    def gather(self, pixel) -> "Illumination":
        """Keep the light of some pixels, UInt32 (n); what is the same everywhere stays of width 1."""

        def pick(value):
            return value if dr.width(value) == 1 else dr.gather(type(value), value, pixel)

        direction, irradiance = [pick(d) for d in self.direction], [pick(e) for e in self.irradiance]
        indirect = None if self.indirect is None else [pick(e) for e in self.indirect]
        dr.make_opaque(direction, irradiance, indirect)
        return replace(self, direction=direction, irradiance=irradiance, indirect=indirect)

    def seen(self, share: np.ndarray) -> "Illumination":
        """Multiply the irradiance of each LED by its visibility, share (n_led, n_pixel)."""
        Float = type(self.irradiance[0])
        irradiance = [e * owned(Float, row) for e, row in zip(self.irradiance, share)]
        dr.make_opaque(irradiance)
        return replace(self, irradiance=irradiance)

    def share_of(self, whole: "Illumination", n_pixel: int) -> np.ndarray:
        """Give what is left (n_led, n_pixel) of the irradiance of the same light without cast shadows."""
        rows = ((e.numpy(), w.numpy()) for e, w in zip(self.irradiance, whole.irradiance))
        shares = (np.where(w > 0, e / np.where(w > 0, w, 1), 1) for e, w in rows)
        return np.stack([np.broadcast_to(np.minimum(s, 1), n_pixel) for s in shares]).astype(np.float32)

    def far(self, whole: "Illumination", pixel: np.ndarray) -> "Illumination":
        """Give every LED one direction and one irradiance, the means over some pixels; visibility stays.

        Parameters
        ----------
        whole : Illumination
            The same light without cast shadows.
        pixel : (n,) int
            The pixels.
        """
        direction, irradiance = [], []
        for d, e, unblocked in zip(self.direction, self.irradiance, whole.irradiance):
            arriving = np.stack([c.numpy() for c in d])
            if arriving.shape[1] == 1:
                direction.append(d)
                irradiance.append(e)
                continue
            mean = arriving[:, pixel].mean(axis=1)
            level = float(unblocked.numpy()[pixel].mean())
            direction.append(type(d)(*(mean / np.linalg.norm(mean)).tolist()))
            share = dr.select(unblocked > 0, e / dr.maximum(unblocked, 1e-20), 0.0)
            irradiance.append(type(e)(level) if e is unblocked else level * share)
        return replace(self, direction=direction, irradiance=irradiance)


def pixel_horizon(p, q, links):
    """Give the softness of the horizon that averages over a pixel of a curved surface.

    n . l varies within a pixel; at the horizon the mean of max(0, n . l) over normally distributed values of standard
    deviation s is s / sqrt(2 pi), which `soft_max0` gives for a softness of 0.8 s. Of a gradient of the normal g per
    pixel, s^2 = |g|^2 / 12, and half of it lies along l.

    Parameters
    ----------
    p, q : Float, (n_pixel)
        Slopes.
    links : solve.grid.Links
        Neighbours, whose normals give the gradient.

    Returns
    -------
    Float, (n_pixel)
        Softness, 0 where there are no neighbours.
    """
    Float = type(p)
    inv = dr.rsqrt(1.0 + p * p + q * q)
    normal = [-p * inv, -q * inv, inv]
    dr.eval(normal)
    variance = dr.zeros(Float, dr.width(p))
    for before, after in (("left", "right"), ("up", "down")):
        pixels = dr.select(links.exists[before], Float(1.0), 0.0) + dr.select(
            links.exists[after], Float(1.0), 0.0
        )
        change = sum(
            dr.square(dr.gather(Float, n, links.index[after]) - dr.gather(Float, n, links.index[before]))
            for n in normal
        )
        variance += change / dr.square(dr.maximum(pixels, 1.0)) / 24.0
    return OF_SPREAD * dr.sqrt(variance)
