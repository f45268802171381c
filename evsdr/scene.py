"""The thin layer over Mitsuba: a scene.xml as the rest of evsdr sees it."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from evsdr import spectral
from evsdr.depth import CameraGeometry
from evsdr.errors import InputError
from evsdr.integrators.gather import Surface, gather, pixel_finder
from evsdr.integrators.leds import Leds
from evsdr.integrators.ring import RingIntegrator, camera_frame, find_object, pixel_mean, rotate
from evsdr.records import Maps
from evsdr.shading import Illumination, led_signals

TRUTH_NODES = 16  # of the quadrature of true reflectances: four times those of the renderer
GATHER_RAYS = 64  # per pixel, of indirect light
MOST_GATHERINGS = 3  # more inter-reflections hardly add light


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


def camera_geometry(sensor: mi.Sensor) -> tuple[CameraGeometry, np.ndarray]:
    """Give where the pixels look, and the transformation (4, 4) from the camera frame to the world."""
    ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f([0, 1], [0, 1]), mi.Point2f(0.5))  # corners of the film
    frame, to_world = camera_frame(sensor), np.eye(4)
    to_world[:3, :3] = frame.T
    to_world[:3, 3] = np.array(sensor.world_transform().matrix, float).reshape(4, 4)[:3, 3]
    perspective = sensor.class_name() == "PerspectiveCamera"
    if perspective:
        direction = frame @ np.array(ray.d, float)
        x, y = direction[:2] / -direction[2]
    else:
        x, y = (frame @ (np.array(ray.o, float) - to_world[:3, 3:]))[:2]
    width, height = (int(n) for n in sensor.film().crop_size())
    size = float(x[1] - x[0]) / width, float(y[0] - y[1]) / height
    return CameraGeometry(perspective, size, (-float(x[0]) / size[0], float(y[0]) / size[1])), to_world


def _central(ring: RingScene) -> tuple[mi.SurfaceInteraction3f, mi.Bool]:
    """Give what the pixels' centres see, and whether that is the object."""
    pixel = dr.arange(mi.UInt32, ring.height * ring.width)
    place = mi.Point2f(pixel % ring.width, pixel // ring.width) + 0.5
    ray, _ = ring.sensor.sample_ray(0.0, 0.5, place / mi.Point2f(ring.width, ring.height), mi.Point2f(0.5))
    si = ring.scene.ray_intersect(ray)
    return si, si.is_valid() & (si.shape == find_object(ring.scene))


def object_normals(ring: RingScene) -> np.ndarray:
    """Give the normals (height, width, 3) of the object at pixel centres, camera frame; (0, 0, 1) elsewhere."""
    si, seen = _central(ring)
    normal = rotate(camera_frame(ring.sensor), dr.mulsign(si.sh_frame.n, si.wi.z))
    normal = dr.select(seen, normal, mi.Vector3f(0, 0, 1))
    return np.stack([n.numpy() for n in normal], axis=-1).reshape(ring.height, ring.width, 3)


def object_depth(ring: RingScene) -> np.ndarray:
    """Give the depth (height, width) of the object at pixel centres [scene units]; 0 where it is not seen."""
    si, seen = _central(ring)
    _, to_world = camera_geometry(ring.sensor)
    distance = dr.dot(mi.Point3f(to_world[:3, 3]) - si.p, mi.Vector3f(to_world[:3, 2]))
    return dr.select(seen, distance, 0.0).numpy().reshape(ring.height, ring.width)


def with_object(ring: RingScene, position: np.ndarray, face: np.ndarray) -> RingScene:
    """Put a triangle mesh in the place of the object; all else stays, occluders too.

    Parameters
    ----------
    position : (n_vertex, 3) float
        Vertices in the world.
    face : (n_face, 3) int
        Vertices of each triangle.
    """
    mesh = mi.Mesh("object", len(position), len(face))
    mesh.set_id("object")
    _move(mesh, position, face)
    others = [s for s in ring.scene.shapes() if s.id() != "object"]
    lights = [e for e in ring.scene.emitters() if e.get_shape() is None]
    parts = [ring.integrator, ring.sensor, mesh, *others, *lights]
    names = [part.id() for part in parts]
    scene = mi.load_dict({"type": "scene"} | {f"part_{i}": part for i, part in enumerate(parts)})
    for part, name in zip(parts, names):
        part.set_id(name)  # the dictionary has renamed them
    return replace(ring, scene=scene, leds=ring.integrator.leds(scene))


def move_object(ring: RingScene, position: np.ndarray, face: np.ndarray) -> None:
    """Move the vertices of a mesh from `with_object`; as many vertices and triangles as it has."""
    scene = mi.traverse(ring.scene)
    scene["object.vertex_positions"] = mi.Float(np.ravel(position).astype(np.float32))
    scene["object.faces"] = mi.UInt32(np.ravel(face).astype(np.uint32))
    scene.update()


def _move(mesh: mi.Mesh, position: np.ndarray, face: np.ndarray) -> None:
    part = mi.traverse(mesh)
    part["vertex_positions"] = mi.Float(np.ravel(position).astype(np.float32))
    part["faces"] = mi.UInt32(np.ravel(face).astype(np.uint32))
    part.update()


def trace_illumination(
    ring: RingScene, spp: int, shadows: bool, seed: int = 0, skip: float = 0.0
) -> tuple[Illumination, np.ndarray]:
    """Trace what the LEDs send to each pixel of the object, and how much of the pixel it covers.

    Parameters
    ----------
    spp : int
        Rays per pixel.
    shadows : bool
        Trace cast shadows.
    skip : float
        Occluders nearer than that don't count [scene units].

    Returns
    -------
    Illumination
        Arrays of width 1 or height * width.
    coverage : (height, width) float32
    """
    light, coverage = ring.integrator.illumination(ring.scene, ring.sensor, spp, seed, shadows, skip)
    dr.eval(light.direction, light.irradiance, coverage)
    return light, coverage.numpy().reshape(ring.height, ring.width)


def trace_indirect(
    ring: RingScene, maps: Maps, light: Illumination, max_depth: int, seed: int, skip: float
) -> list[mi.Float]:
    """Gather what each LED sends to the object by way of other surfaces.

    Parameters
    ----------
    maps : Maps
        Normals and reflectances of the object as far as they are known: where a reflectance is not 0.
    light : Illumination
        The direct light that reaches the pixels; arrays of width 1 or height * width.
    max_depth : int
        Surface points on a light path; one gathering is made for each after the first, 3 at most.
    skip : float
        What is hit nearer than that is the surface itself [scene units].

    Returns
    -------
    list of mi.Float, (n_led) of width height * width
        Irradiance, in the unit of the direct one.
    """
    camera, to_world = camera_geometry(ring.sensor)
    place, seen = _central(ring)
    normal = mi.Vector3f(*(mi.Float(np.ravel(n)) for n in np.moveaxis(maps.normal, -1, 0)))
    # no surface sends more than it gets: a fit without indirect light may say so, and rounds would not settle
    reflectance = [mi.Float(np.ravel(np.minimum(r, 1))) for r in np.moveaxis(maps.reflectance, -1, 0)]
    known = seen & (mi.Float((maps.reflectance > 0).any(axis=-1).ravel().astype(np.float32)) > 0)
    distance = dr.dot(mi.Point3f(to_world[:3, 3]) - place.p, mi.Vector3f(to_world[:3, 2]))
    scale = float(dr.max(dr.select(known, distance, 0.0))[0]) if camera.perspective else 1.0
    surface = Surface(
        shape=find_object(ring.scene),
        place=place,
        normal=rotate(to_world[:3, :3], normal),
        reflectance=reflectance,
        known=known,
        pixel_of=pixel_finder(
            ring.width, ring.height, camera.pixel_size, camera.center, camera.perspective, to_world
        ),
        pixel_size=max(camera.pixel_size) * scale,
    )
    direct = led_signals(replace(light, indirect=None), normal, reflectance)
    out = [dr.zeros(mi.Float, ring.width * ring.height)] * ring.leds.n_led
    for _ in range(min(max(max_depth - 1, 1), MOST_GATHERINGS)):
        signal = [a + reflectance[b] * e for a, b, e in zip(direct, light.band, out)]
        out = gather(ring.scene, ring.leds, surface, signal, GATHER_RAYS, seed, skip)
        dr.eval(out)
    return out


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
