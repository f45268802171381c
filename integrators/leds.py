"""The LEDs of a scene: in schedule order, with what the camera sees of their spectra."""

import re
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from evsdr.model import quadrature

# LEDs that a lane of a kernel takes in turn. Measured with the 24 LEDs of the scenes blob and colorchecker, without AVX-512: all
# in turn take 2.5 and 1.9 times as long to compile, one alone .75 times; but one alone takes 4 and 1.7 times as long to run
IN_TURN = 8
FINER = 1e-3  # error of an LED's power on the grid of wavelengths from which its own points count


@dataclass(frozen=True)
class Led:
    """One LED, of numbers; or one for each lane of a kernel, of arrays.

    Attributes
    ----------
    number : int or mi.UInt32
    emitter : mi.Emitter or mi.EmitterPtr
    choice : list of mi.Emitter
        The one that it is, or one for each copy of the pixels.
    copy : int or mi.UInt32
    power, peak_nm, peak : float or mi.Float
        As in `Leds`.
    node_nm, weight : mi.Spectrum
        As in `Leds`, of the LED's band.
    """

    number: int
    emitter: mi.Emitter
    choice: list
    copy: int
    power: float
    peak_nm: float
    peak: float
    node_nm: mi.Spectrum
    weight: mi.Spectrum


@dataclass(frozen=True)
class Leds:
    """The ring as the integrator uses it.

    Attributes
    ----------
    emitter : list of mi.Emitter
        In schedule order.
    power : (n_led,) float
        INT D E_j: the signal of a white patch that faces LED j (at unit distance, for a near one).
    peak_nm, peak : (n_led,) float
        A wavelength at which E_j is strong [nm], and E_j there. What the emitter gives at this wavelength,
        divided by `peak`, is its geometric factor, whatever the spectrum.
    band : (n_led,) int
        Band of each LED.
    node_nm, weight : (n_band, 4) float
        Quadrature of each band's D E: wavelengths [nm] and weights of sum 1.
    band_wavelength_nm : (n_band,) float
        Centroid of each band [nm].
    band_spectrum : (n_band, n_wavelength) float
        D E of each band's first LED over `quadrature.WAVELENGTH_NM`.
    curves : list of quadrature.Curve
        Reflectances of the scene for which nodes and weights were chosen.
    """

    emitter: list
    power: np.ndarray
    peak_nm: np.ndarray
    peak: np.ndarray
    band: np.ndarray
    node_nm: np.ndarray
    weight: np.ndarray
    band_wavelength_nm: np.ndarray
    band_spectrum: np.ndarray
    curves: list

    @property
    def n_led(self) -> int:
        return len(self.emitter)

    @property
    def n_band(self) -> int:
        return len(self.node_nm)

    def one(self, j: int) -> Led:
        """Give LED j."""
        number = (float(value[j]) for value in (self.power, self.peak_nm, self.peak))
        band = (mi.Spectrum(value[self.band[j]].tolist()) for value in (self.node_nm, self.weight))
        return Led(j, self.emitter[j], [self.emitter[j]], 0, *number, *band)

    def in_lanes(self, scene: mi.Scene, n_pixel: int) -> list[Led]:
        """Share the LEDs out to lanes of a kernel, of which each pixel gets one or more.

        A kernel then holds the kinds of LEDs, not each of them, and is as short for hundreds as for a few.

        Returns
        -------
        list of Led, arrays of width n_copy * n_pixel
            All pixels of the first copy come first. Their values, end to end, have all pixels of LED 0 first, then those of
            LED 1; of LEDs that there are not they repeat the last.
        """
        n_copy = -(-self.n_led // IN_TURN)
        copy = dr.arange(mi.UInt32, n_copy * n_pixel) // n_pixel
        every = scene.emitters()
        order = mi.UInt32([every.index(emitter) for emitter in self.emitter])
        # value by value: whether Dr.Jit gathers packets of four hangs on where an array lies, and so would kernels
        tables = [self.power, self.peak_nm, self.peak, *self.node_nm[self.band].T, *self.weight[self.band].T]
        tables = [mi.Float(table) for table in tables]
        lanes = []
        for k in range(-(-self.n_led // n_copy)):
            number = dr.minimum(k * n_copy + copy, self.n_led - 1)
            emitter = dr.gather(mi.EmitterPtr, scene.emitters_dr(), dr.gather(mi.UInt32, order, number))
            choice = [self.emitter[min(j, self.n_led - 1)] for j in range(k * n_copy, (k + 1) * n_copy)]
            values = [dr.gather(mi.Float, table, number) for table in tables]
            spectra = mi.Spectrum(*values[3:7]), mi.Spectrum(*values[7:])
            lanes.append(Led(number, emitter, choice, copy, *values[:3], *spectra))
        return lanes

    def is_far(self, j: int) -> bool:
        """Tell whether LED j is directional."""
        return is_far(self.emitter[j])


def emitter_id(emitter: mi.Emitter) -> str:
    """Name an emitter: its own id, or that of the shape it makes shine."""
    shape = emitter.get_shape()
    return emitter.id() if shape is None else shape.id()


def find_leds(scene: mi.Scene, response: mi.Texture | None = None) -> Leds:
    """Collect the emitters named `led...` and measure their spectra.

    Parameters
    ----------
    scene : mi.Scene
        Scene; the order of its own emitter list does not matter.
    response : mi.Texture, optional
        Spectral response D of the camera; 1 where none is given.

    Returns
    -------
    Leds

    Raises
    ------
    ValueError
        The scene has no LED, or the camera can't see one of them.
    """
    named = [(emitter_id(e), e) for e in scene.emitters()]
    named = sorted((pair for pair in named if pair[0].startswith("led")), key=lambda pair: _natural(pair[0]))
    if not named:
        raise ValueError("no emitter has an id that starts with 'led'")
    curves, others = find_curves(scene)
    points = np.concatenate([nm for nm, _ in others]) if others else np.empty(0)
    spectra = [_spectrum(e, points) for _, e in named]
    irradiance, peak_nm, peak = (np.array(part) for part in zip(*spectra))
    seen = irradiance * _response(response)
    power = quadrature.integrate(seen)
    for (name, _), p in zip(named, power):
        if not p > 0:
            raise ValueError(f"emitter '{name}' gives the camera no light between 360 and 830 nm")
    band = quadrature.group_bands(seen)
    first = [int(np.flatnonzero(band == b)[0]) for b in range(band.max() + 1)]
    rules = [quadrature.quadrature_for(seen[j], curves) for j in first]
    return Leds(
        emitter=[e for _, e in named],
        power=power,
        peak_nm=peak_nm,
        peak=peak,
        band=band,
        node_nm=np.array([node for node, _ in rules]),
        weight=np.array([weight for _, weight in rules]),
        band_wavelength_nm=quadrature.integrate(seen[first] * quadrature.WAVELENGTH_NM) / power[first],
        band_spectrum=seen[first],
        curves=curves,
    )


def is_far(emitter: mi.Emitter) -> bool:
    """Tell whether an emitter is directional: the same direction and irradiance everywhere."""
    return mi.has_flag(emitter.flags(), mi.EmitterFlags.DeltaDirection)


def _natural(name: str) -> list:
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _packets() -> mi.Spectrum:
    """Lay the wavelength grid out as four-wavelength packets."""
    return _packed(quadrature.WAVELENGTH_NM, 830.0)


def _packed(values: np.ndarray, end: float = 0.0) -> mi.Spectrum:
    padded = np.append(values, np.full(-len(values) % 4, end))
    return mi.Spectrum(np.ascontiguousarray(padded.reshape(-1, 4).T.astype(np.float32)))


def _unpack(value: mi.Spectrum, n: int = len(quadrature.WAVELENGTH_NM)) -> np.ndarray:
    n_packet = -(-n // 4)  # a flat spectrum comes as a single packet
    return np.broadcast_to(np.array(value, dtype=float).T, (n_packet, 4)).ravel()[:n]


def find_curves(scene: mi.Scene) -> tuple[list, list]:
    """Collect the spectra that `mi.traverse` shows as values over wavelengths: reflectances, and all others."""
    parts: dict[str, dict] = {}
    for name, value in mi.traverse(scene):
        owner, _, part = name.rpartition(".")
        if part in ("values", "wavelengths", "range"):
            parts.setdefault(owner, {})[part] = np.array(value, float).ravel()
    found: tuple[list, list] = ([], [])
    for owner, part in parts.items():
        if "values" in part and len(part) == 2:
            nm = part.get("wavelengths")
            nm = np.linspace(*part["range"], len(part["values"])) if nm is None else nm
            found[0 if owner.endswith("reflectance") else 1].append((nm, part["values"]))
    return found


def _spectrum(emitter: mi.Emitter, points: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Read an emitter's spectrum by asking what it sends to a place that it lights; gives also where it is strong.

    It has points beside those of the grid: where it is finer than the grid it is laid out by its integral.
    """
    grid = quadrature.WAVELENGTH_NM
    value = _unpack(_packets_of(emitter, _packets()))
    fine = np.union1d(grid, points[(points > grid[0]) & (points < grid[-1])]).astype(np.float32).astype(float)
    if len(fine) > len(grid):
        finely = _unpack(_packets_of(emitter, _packed(fine, fine[-1])), len(fine))
        power = np.trapezoid(finely, fine)
        if abs(quadrature.integrate(value) - power) > FINER * power:
            at = finely.argmax()
            return quadrature.cell_means((fine, finely)), fine[at], finely[at]
    at = value.argmax()
    return value, grid[at], value[at]


def _packets_of(emitter: mi.Emitter, wavelengths: mi.Spectrum) -> mi.Spectrum:
    shape = emitter.get_shape()
    it = dr.zeros(mi.SurfaceInteraction3f)
    it.wavelengths = wavelengths
    if shape is not None:
        on_light = shape.sample_position(0.0, mi.Point2f(0.5))
        it.p, it.n = on_light.p, on_light.n
        it.wi = mi.Vector3f(0, 0, 1)
        return emitter.eval(it)
    far = is_far(emitter)
    if not far:  # before the LED, wherever the scene ends: else its power's last bits hang on that, and kernels that hold it
        centre, _ = emitter.sample_direction(it, mi.Point2f(0.5))
        ahead = mi.Vector3f(0, 0, 1)
        axis = dr.normalize(emitter.world_transform() @ ahead)
        axis = dr.select(dr.all(dr.isfinite(axis)), axis, ahead)  # a frame that is flat is refused elsewhere
        it.p = centre.p + dr.maximum(dr.norm(centre.p), 1.0) * axis  # whatever the unit of length is
    dr.make_opaque(it.p)
    ds, irradiance = emitter.sample_direction(it, mi.Point2f(0.5))
    return irradiance * dr.square(1.0 if far else ds.dist)


def power_factor(leds: Leds, j: int, response: mi.Texture | None = None) -> mi.Float:
    """Give 1, with the derivative of log (INT D E_j / E_j at its peak) by what the LED's spectrum hangs on.

    The geometric factor is what arrives at the peak wavelength, relative to a number; with this factor beside it the
    derivative is that of the whole spectrum.
    """
    emitter = leds.emitter[j]
    weight = _packed(_response(response) * quadrature.trapezoid_weights())
    spectrum = _packets_of(emitter, _packets())
    power = dr.sum(dr.sum(spectrum * weight))
    if not dr.all(power > 0):  # lines between the wavelengths of the grid: their shape stays
        return mi.Float(1.0)
    peak = _packets_of(emitter, mi.Spectrum(float(leds.peak_nm[j])))[0]
    return power / dr.detach(power) * dr.detach(peak) / peak


def _response(texture: mi.Texture | None) -> np.ndarray:
    if texture is None:
        return np.ones_like(quadrature.WAVELENGTH_NM)
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wavelengths = _packets()
    return _unpack(texture.eval(si))
