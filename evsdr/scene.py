"""The thin layer over Mitsuba: a scene.xml as the rest of evsdr sees it."""

import re
from dataclasses import dataclass
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from evsdr import spectral
from evsdr.errors import InputError
from evsdr.integrators.leds import Leds
from evsdr.integrators.ring import RingIntegrator, camera_frame, find_object, pixel_mean, rotate
from evsdr.records import Maps
from evsdr.shading import Illumination

TRUTH_NODES = 16  # of the quadrature of true reflectances: four times those of the renderer


@dataclass(frozen=True)
class RingScene:
    """A loaded scene with its ring.

    Attributes
    ----------
    path : Path
        The file.
    scene, integrator, sensor
        Mitsuba's objects.
    leds : Leds
        The ring.
    height, width : int
        Film [pixels].
    constant_light : float
        C_w.
    """

    path: Path
    scene: mi.Scene
    integrator: RingIntegrator
    sensor: mi.Sensor
    leds: Leds
    height: int
    width: int
    constant_light: float

    @property
    def is_near(self) -> bool:
        """Whether any LED is at finite distance."""
        return not all(self.leds.is_far(j) for j in range(self.leds.n_led))

    @property
    def shape_is_known(self) -> bool:
        """False where the object is a `rectangle`, which stands for an unknown shape."""
        return all(s.class_name() != "Rectangle" for s in self.scene.shapes() if s.id() == "object")


def load_scene(path: Path, define: dict[str, str] | None = None) -> RingScene:
    """Load and check a scene.xml.

    Parameters
    ----------
    path : Path
        The file.
    define : dict, optional
        Values for the file's `<default>` parameters.

    Raises
    ------
    InputError
        The file is missing or wrong.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a scene.xml.")
    try:
        scene = mi.load_file(str(path), optimize=False, **(define or {}))
    except (RuntimeError, ValueError, TypeError) as error:
        raise InputError(
            f"{path}: Mitsuba can't load it: {_in_one_line(error)}; correct the file, or what -D sets in it."
        ) from error
    if not isinstance(scene, mi.Scene):
        raise InputError(f"{path}: it is not a scene; its root element must be <scene>.")
    integrator = scene.integrator()
    if not isinstance(integrator, RingIntegrator):
        raise InputError(f'{path}: its integrator is not the ring; write <integrator type="ring">.')
    sensors = scene.sensors()
    sensor = next((s for s in sensors if s.id() == "camera"), sensors[0] if len(sensors) == 1 else None)
    if sensor is None:
        raise InputError(f'{path}: no sensor has id="camera"; add one, orthographic or perspective.')
    if sensor.class_name() not in ("OrthographicCamera", "PerspectiveCamera"):
        raise InputError(f'{path}: the sensor "camera" must be orthographic or perspective; change its type.')
    width, height = (int(n) for n in sensor.film().crop_size())
    if width * height == 0:
        raise InputError(f"{path}: the film is {width} x {height} pixels; make it as large as the sensor.")
    if integrator.max_depth != int(integrator.max_depth):
        raise InputError(f"{path}: max_depth is {integrator.max_depth:g}; it must be an integer, 1 or more.")
    try:
        leds = integrator.leds(scene)
        find_object(scene)
    except ValueError as error:
        raise InputError(f"{path}: {error}; see scenes/README.md for a scene that works.") from error
    if not 2 <= leds.n_led <= 256:
        raise InputError(
            f"{path}: the number of LEDs is {leds.n_led}; write 2 to 256, led_00, led_01 and so on."
        )
    constant_light = float(integrator.constant_light[0])
    if not constant_light >= 0 or not np.isfinite(constant_light):
        raise InputError(f"{path}: constant_light is {constant_light:g}; it must be 0 or more.")
    return RingScene(path, scene, integrator, sensor, leds, height, width, constant_light)


def _in_one_line(error: Exception) -> str:
    """Leave out what speaks of Mitsuba's own source: traceback, file and line."""
    text = re.sub(r"Traceback \(most recent call last\):.*\n", "", str(error).strip(), flags=re.DOTALL)
    text = re.sub(r"\[\w+\.cpp:\d+\] |\b[A-Z]\w+Error: ", "", text)
    return re.sub(r"\s*\n[\s-]*", " ", text).rstrip(".!")


def led_images(ring: RingScene, spp: int, seed: int = 0) -> np.ndarray:
    """Render A_xj, without the constant light.

    Returns
    -------
    (n_led, height, width) float32
    """
    signal = ring.integrator.signals(ring.scene, ring.sensor, spp, seed)
    return np.stack([s.numpy().reshape(ring.height, ring.width) for s in signal])


def trace_illumination(
    ring: RingScene, spp: int, shadows: bool, seed: int = 0
) -> tuple[Illumination, np.ndarray]:
    """Trace what the LEDs send to each pixel of the object, and how much of the pixel it covers.

    Returns
    -------
    Illumination
        Arrays of width 1 or height * width.
    coverage : (height, width) float32
    """
    light, coverage = ring.integrator.illumination(ring.scene, ring.sensor, spp, seed, shadows)
    dr.eval(light.direction, light.irradiance, coverage)
    return light, coverage.numpy().reshape(ring.height, ring.width)


def _fine_quadrature(spectrum: np.ndarray) -> list[tuple[mi.Spectrum, mi.Spectrum]]:
    """Give nodes and weights in packets of four, more of them than the renderer uses."""
    quadrature = spectral.gauss_quadrature(spectrum, TRUTH_NODES)
    return [
        tuple(mi.Spectrum(part.tolist()) for part in pair)
        for pair in zip(*(q.reshape(-1, 4) for q in quadrature))
    ]


def surface_maps(ring: RingScene, spp: int, seed: int = 0) -> Maps:
    """Give the true normals and band reflectances of the object, averaged over each pixel's area.

    The mask holds the pixels that the object covers whole. Reflectance is that of diffuse reflection.
    """
    leds, frame = ring.leds, camera_frame(ring.sensor)
    packets = [_fine_quadrature(spectrum) for spectrum in leds.band_spectrum]
    target = find_object(ring.scene)

    def measure(si, ray, rng, active):
        active = active & si.is_valid() & (si.shape == target)
        normal = rotate(frame, dr.mulsign(si.sh_frame.n, si.wi.z))
        values = [mi.Float(1.0), *normal]
        bsdf = si.bsdf(ray)
        for band in packets:
            total = mi.Float(0.0)
            for nodes, weights in band:
                si.wavelengths = nodes
                total += dr.sum(weights * bsdf.eval_diffuse_reflectance(si, active))
            values.append(total)
        return [dr.select(active, v, 0.0) for v in values]

    values = pixel_mean(ring.scene, ring.sensor, spp, seed, 4 + leds.n_band, measure)
    dr.eval(values)
    shape = (ring.height, ring.width)
    coverage, *values = (v.numpy().reshape(shape) for v in values)
    mask = coverage > 1 - 1e-4
    normal = np.stack(values[:3], axis=-1)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(length > 0, normal / np.maximum(length, 1e-12), [0, 0, 1])
    reflectance = np.stack(values[3:], axis=-1) / np.maximum(coverage, 1e-6)[..., None]
    return Maps(
        normal=normal.astype(np.float32),
        reflectance=reflectance.astype(np.float32),
        mask=mask,
        normal_sigma_deg=np.zeros(shape, np.float32),
        reflectance_sigma=np.zeros_like(reflectance, dtype=np.float32),
        band_wavelength_nm=leds.band_wavelength_nm.astype(np.float32),
    )
