"""The thin layer over Mitsuba: a scene.xml as the rest of evsdr sees it."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import mitsuba as mi
import numpy as np

from evsdr.errors import InputError, check_memory
from evsdr.files.kind import XML, other_kind
from evsdr.integrators.leds import Leds, emitter_id
from evsdr.integrators.ring import RingIntegrator, find_object
from evsdr.jit import threads_for_images
from evsdr.light.clip_planes import open_clip_planes
from evsdr.light.scene_file import check_scene_file, known_plugins
from evsdr.model.arrays import owned

DEEPEST = 16  # surface points on a light path; guessed: hardly any light goes farther
PIXEL_BYTES = 500.0  # of memory, at least: one direction and irradiance for each of 24 LEDs
LEAST_POWER, MOST_POWER = 1e-15, 1e15  # whose squares float32 holds


@dataclass(frozen=True)
class RingScene:
    """A loaded scene with its ring.

    Attributes
    ----------
    path : Path or str
        The file, or what stands for it in sentences.
    scene, integrator, sensor
        Mitsuba's objects.
    leds : Leds
        The ring.
    height, width : int
        Film [pixels].
    constant_light : float
        C_w.
    trim : (n_led,) float, optional
        By which the file's LEDs were made weaker; `leds` has it, the integrator does not.
    """

    path: Path | str
    scene: mi.Scene
    integrator: RingIntegrator
    sensor: mi.Sensor
    leds: Leds
    height: int
    width: int
    constant_light: float
    trim: np.ndarray | None = None

    def trimmed(self, trim: np.ndarray) -> "RingScene":
        """Give the scene under LEDs of another brightness (n_led,), above 0, relative to what the file says."""
        return replace(
            self, leds=replace(self.leds, power=self.leds.power * trim), trim=np.asarray(trim, float)
        )

    @property
    def is_near(self) -> bool:
        """Whether any LED is at finite distance."""
        return not all(self.leds.is_far(j) for j in range(self.leds.n_led))

    @property
    def shape_is_known(self) -> bool:
        """False where the object is a `rectangle`, which stands for an unknown shape."""
        return all(s.class_name() != "Rectangle" for s in self.scene.shapes() if s.id() == "object")


def load_scene(path: str | Path | dict, define: dict[str, str] | None = None) -> RingScene:
    """Load and check a scene.xml.

    Parameters
    ----------
    path : str, Path or dict
        The file; or a dictionary as of `mitsuba.load_dict`, whose keys are the ids.
    define : dict, optional
        Values for the file's `<default>` parameters.

    Raises
    ------
    InputError
        The file is missing or wrong.
    """
    path, load = _source(path, define or {})
    try:
        with threads_for_images():
            scene = load()
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
    film = f"{path}: a film of {width} x {height} pixels"
    check_memory(film, width * height * PIXEL_BYTES, "make it as large as the sensor")
    if not 1 <= integrator.max_depth <= DEEPEST or integrator.max_depth != int(integrator.max_depth):
        remedy = f"an integer, {'1 or more' if integrator.max_depth < DEEPEST else f'{DEEPEST} at most'}"
        raise InputError(f"{path}: max_depth is {integrator.max_depth:g}; it must be {remedy}.")
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
    _check_places(path, sensor, leds)
    open_clip_planes(sensor, scene.bbox())
    return RingScene(path, scene, integrator, sensor, leds, height, width, constant_light)


def _check_places(path: Path | str, sensor: mi.Sensor, leds: Leds) -> None:
    """Refuse a camera and LEDs that are nowhere, shine from everywhere, or with no power that float can hold."""
    if not abs(np.linalg.det(_frame(sensor))) > 0:
        raise InputError(f'{path}: to_world of the sensor "camera" is not finite or flat; correct it.')
    for emitter, power in zip(leds.emitter, leds.power):
        name = emitter_id(emitter)
        everywhere = mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite)
        if everywhere and not mi.has_flag(emitter.flags(), mi.EmitterFlags.DeltaDirection):
            raise InputError(
                f"{path}: emitter '{name}' shines from everywhere; write LEDs as directional or point, or as a shape "
                "with an area emitter."
            )
        if not LEAST_POWER <= power <= MOST_POWER:
            raise InputError(
                f"{path}: emitter '{name}' has a power of {power:g}; give numbers from {LEAST_POWER:g} to "
                f"{MOST_POWER:g}, in any unit."
            )
        if emitter.get_shape() is None and not abs(np.linalg.det(_frame(emitter))) > 0:
            raise InputError(
                f"{path}: emitter '{name}' has a direction or position that is 0 or not finite; correct it."
            )


def _frame(part) -> np.ndarray:
    """Give the axes of a sensor or an emitter (3, 3); zeros if it stands nowhere."""
    matrix = np.array(part.world_transform().matrix, float).reshape(4, 4)
    return matrix[:3, :3] if np.isfinite(matrix).all() else np.zeros((3, 3))


def _source(given: str | Path | dict, define: dict[str, str]) -> tuple[Path | str, Callable]:
    """Give the name of a scene, and what loads it."""
    if isinstance(given, dict):
        if define:
            raise InputError(f"a scene given as a dictionary has no parameter {next(iter(define))} to set.")
        return "the scene", partial(mi.load_dict, given, optimize=False)
    path = Path(given)
    if not path.exists():
        raise InputError(f"{path}: no such file; give the path of a scene.xml.")
    other = other_kind(path, XML, "a scene.xml")
    if other:
        raise InputError(other)
    own = Path(mi.__file__).parent
    looked_in = [Path(str(folder)) for folder in mi.file_resolver()]
    folders = check_scene_file(path, define, tuple(looked_in))
    if any((folder / "plugins").exists() for folder in {*folders, *looked_in} - {own}):
        _load_own_plugins(own)
    return path, partial(mi.load_file, str(path), optimize=False, **define)


@cache
def _load_own_plugins(folder: Path) -> None:
    """Load all of Mitsuba's plugins from its own folder: of two of one name it takes that beside the scene, else."""
    resolver = mi.file_resolver()
    before = [str(path) for path in resolver]
    resolver.clear()
    resolver.append(str(folder))
    try:
        for name in sorted(known_plugins()):
            mi.PluginManager.instance().plugin_type(name)
    finally:
        resolver.clear()
        for path in before:
            resolver.append(path)


def _in_one_line(error: Exception) -> str:
    """Leave out what speaks of Mitsuba's own source: traceback, file and line."""
    text = re.sub(r"Traceback \(most recent call last\):.*\n", "", str(error).strip(), flags=re.DOTALL)
    text = re.sub(r"\[\w+\.cpp:\d+\] |\b[A-Z]\w+Error: ", "", text)
    return re.sub(r"\s*\n[\s-]*", " ", text).rstrip(".!")


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
    placed = replace(ring, scene=scene, leds=ring.integrator.leds(scene))
    return placed if ring.trim is None else placed.trimmed(ring.trim)


def rectangle_corners(ring: RingScene) -> np.ndarray:
    """Give the corners (4, 3) in the world, in order, of the `rectangle` that stands for an unknown shape."""
    shape = next(s for s in ring.scene.shapes() if s.id() == "object")
    to_world = np.array(mi.traverse(shape)["to_world"].matrix, float).reshape(4, 4)
    corner = np.array([[-1, -1, 0, 1], [1, -1, 0, 1], [1, 1, 0, 1], [-1, 1, 0, 1]], float)
    return (corner @ to_world.T)[:, :3]


def move_object(ring: RingScene, position: np.ndarray, face: np.ndarray) -> None:
    """Move the vertices of a mesh from `with_object`; as many vertices and triangles as it has."""
    scene = mi.traverse(ring.scene)
    scene["object.vertex_positions"] = owned(mi.Float, np.ravel(position))
    scene["object.faces"] = owned(mi.UInt32, np.ravel(face))
    scene.update()


def _move(mesh: mi.Mesh, position: np.ndarray, face: np.ndarray) -> None:
    part = mi.traverse(mesh)
    part["vertex_positions"] = owned(mi.Float, np.ravel(position))
    part["faces"] = owned(mi.UInt32, np.ravel(face))
    part.update()
