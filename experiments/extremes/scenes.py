"""A sphere, or something else, before a ring of LEDs, with everything that may be extreme as a number."""

import math
from dataclasses import dataclass

import mitsuba as mi
import numpy as np

WIDEST, SHORT, LONG = 20.0, 400.0, 780.0  # half a band, first and last of them [nm]
VIEW = (
    0.6  # half of what the camera sees, in radii: normals to 58 degrees, 4 degrees within a pixel of 16 x 16
)


@dataclass(frozen=True)
class Scene:
    """What is before the camera, and the ring.

    Attributes
    ----------
    width, height : int
        Film [pixels].
    n_led, n_band : int
    ring_deg : float
        Angle of the ring against the camera's axis.
    power : float
        Of each LED: signal of a white patch that faces it.
    constant_light : float
        C_w, relative to that power.
    reflectance : float
    unit : float
        Length of the sphere's radius in the scene's unit.
    tilt_deg : float, optional
        Of a plane that is there instead of the sphere.
    near : bool
        Whether LEDs are near.
    pole : bool
        Whether a pole shades the sphere.
    open_led : int, optional
        The only LED that is not hidden behind a card.
    """

    width: int = 16
    height: int = 16
    n_led: int = 12
    n_band: int = 4
    ring_deg: float = 45.0
    power: float = 1.0
    constant_light: float = 0.05
    reflectance: float = 0.5
    unit: float = 1.0
    tilt_deg: float | None = None
    near: bool = False
    pole: bool = False
    open_led: int | None = None

    def describe(self) -> dict:
        """Give the scene as a dictionary of Mitsuba's."""
        look = mi.ScalarTransform4f().look_at(
            origin=[0, 0, 4 * self.unit], target=[0, 0, 0], up=[0, 1, 0]
        ) @ mi.ScalarTransform4f().scale([VIEW * self.unit, VIEW * self.unit, 1])
        film = {"type": "hdrfilm", "width": self.width, "height": self.height, "rfilter": {"type": "box"}}
        veil = self.constant_light * self.power
        return {
            "type": "scene",
            "integrator": {"type": "ring", "constant_light": veil},
            "camera": {"type": "orthographic", "to_world": look, "film": film},
            "object": self._object(),
            **{f"led_{j:03d}": self._led(j) for j in range(self.n_led)},
            **self._occluders(),
        }

    def _object(self) -> dict:
        matt = {"type": "diffuse", "reflectance": {"type": "uniform", "value": self.reflectance}}
        if self.tilt_deg is None:
            return {"type": "sphere", "radius": self.unit, "bsdf": matt}
        long = 2 * self.unit / math.cos(math.radians(self.tilt_deg))
        turn = mi.ScalarTransform4f().rotate([0, 1, 0], self.tilt_deg)
        return {
            "type": "rectangle",
            "to_world": turn @ mi.ScalarTransform4f().scale([long, 2 * self.unit, 1]),
            "bsdf": matt,
        }

    def _direction(self, j: int) -> np.ndarray:
        polar, turn = math.radians(self.ring_deg), 2 * math.pi * j / self.n_led
        return np.array([math.sin(polar) * math.cos(turn), math.sin(polar) * math.sin(turn), math.cos(polar)])

    def _led(self, j: int) -> dict:
        step = (LONG - SHORT) / self.n_band
        middle, half = SHORT + (j % self.n_band + 0.5) * step, min(WIDEST, 0.4 * step)
        far = 6 * self.unit
        peak = self.power / half * (far**2 if self.near else 1)
        spectrum = {
            "type": "irregular",
            "wavelengths": f"{middle - half}, {middle}, {middle + half}",
            "values": f"0, {peak!r}, 0",
        }
        if self.near:
            return {"type": "point", "position": (far * self._direction(j)).tolist(), "intensity": spectrum}
        return {"type": "directional", "direction": (-self._direction(j)).tolist(), "irradiance": spectrum}

    def _occluders(self) -> dict:
        if self.pole:
            bottom, top = [0.5 * self.unit, 0, 0.5 * self.unit], [0.5 * self.unit, 0, 2 * self.unit]
            return {"pole": {"type": "cylinder", "p0": bottom, "p1": top, "radius": 0.15 * self.unit}}
        if self.open_led is None:
            return {}
        cards = {}
        for j in set(range(self.n_led)) - {self.open_led}:
            place = (10 * self.unit * self._direction(j)).tolist()
            turn = mi.ScalarTransform4f().look_at(origin=place, target=[0, 0, 0], up=[0, 0, 1])
            size = mi.ScalarTransform4f().scale([1.8 * self.unit, 1.8 * self.unit, 1])
            cards[f"card_{j}"] = {"type": "rectangle", "to_world": turn @ size}
        return cards
