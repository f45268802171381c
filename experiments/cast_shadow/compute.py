"""Recordings with cast shadows, fitted in each way; errors inside and outside of the shadow."""

import os
import warnings
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import copytree, ignore_patterns
from unittest import mock

import numpy as np
import trimesh

import evsdr
from evsdr import Fit, InputWarning, Maps, Recording, Settings, Truth, angular_error_deg

REPOSITORY = Path(__file__).resolve().parents[2]
SCENES = REPOSITORY / "scenes"
WAYS = {
    "off": Settings(shadows="off"),
    "paper": Settings(solver="adam", shadows="downweight"),
    "downweight": Settings(shadows="downweight"),
    "estimate": Settings(shadows="estimate"),
    "auto": Settings(),
    "unmasked": Settings(),  # and no mask tells which pixels are the object
    "latent": Settings(shadows="latent"),
    "events": Settings(shadows="latent"),  # and nothing is traced, see `events_alone`
    "scene": Settings(shadows="scene"),
}
MESHES = {
    "nefertiti": "nefertiti-lowres.obj",
    "skull": "skull_low_resolution.obj",
    "goathead": "goathead.obj",
    "lion statue": "lionstatue.obj",
    "Demosthenes": "demosthenes-low-res.obj",
}
BLOCKED = 0.5  # visibility below which an LED counts as hidden
FACING = 0.05  # cosine from which a surface that faces an LED should be lit
MOVED = 0.02  # of the pole: 1 % of the sphere's diameter
RAYS = 4  # per pixel, for the true visibility
THRESHOLDS = "contrast_threshold_on", "contrast_threshold_off"


@dataclass(frozen=True)
class Case:
    """A recording to make.

    Attributes
    ----------
    name : str
    scene : Path
        What is recorded.
    told : Path
        The scene that it is fitted with: where the shape is unknown, a rectangle stands for it.
    known : Path
        The same for shadows `scene`.
    """

    name: str
    scene: Path
    told: Path
    known: Path


@dataclass(frozen=True)
class Shadow:
    """Cast shadows as they are.

    Attributes
    ----------
    direction : (n_led, n_pixel, 3) float
        Unit vectors from surface to light.
    hidden : (H, W) int
        How many LEDs that the pixel faces are hidden from it.
    """

    direction: np.ndarray
    hidden: np.ndarray


@dataclass(frozen=True)
class Result:
    """What one way of fitting recovered.

    Attributes
    ----------
    way : str
        Of `WAYS`.
    maps : Maps
    truth : Truth
    hidden : (H, W) int
        LEDs that are hidden from each pixel that faces them, in truth.
    found : (H, W) int, optional
        The same as the events told, where that is modelled.
    seconds : float
        Of the fit.
    """

    way: str
    maps: Maps
    truth: Truth
    hidden: np.ndarray
    found: np.ndarray | None
    seconds: float

    @property
    def known(self) -> np.ndarray:
        """Pixels (H, W) of the object that the fit knows."""
        return self.truth.mask & self.maps.mask

    @property
    def inside(self) -> np.ndarray:
        """Known pixels (H, W) in the shadow of some LED that they face."""
        return self.known & (self.hidden > 0)

    @property
    def outside(self) -> np.ndarray:
        """Known pixels (H, W) that see all LEDs that they face."""
        return self.known & (self.hidden == 0)

    @property
    def error_deg(self) -> np.ndarray:
        """Angular error (H, W) of the normals [deg]."""
        return angular_error_deg(self.maps.normal, self.truth.normal)

    @property
    def rms(self) -> np.ndarray:
        """Root mean square error (H, W) of the reflectance over the bands."""
        return np.sqrt(np.mean((self.maps.reflectance - self.truth.reflectance) ** 2, axis=-1))

    def within(self, n_sigma: float) -> float:
        """Give the share of the known pixels whose normals are within so many sigmas."""
        return float(np.mean((self.error_deg <= n_sigma * self.maps.normal_sigma_deg)[self.known]))


def data_folder() -> Path:
    """Say where the meshes should be: in $EVSDR_DATA, else in ../shared/data beside the repository."""
    return Path(os.environ.get("EVSDR_DATA") or REPOSITORY.parent / "shared/data") / "meshes"


def cases(folder: Path) -> list[Case]:
    """List what can be recorded; scenes of meshes are written into the folder, where the meshes are present."""
    pole, soft, two, relief = (
        SCENES / f"{name}.xml" for name in ("sphere_pole", "soft_ring", "two_spheres", "relief")
    )
    bare, unknown, moved = SCENES / "sphere.xml", SCENES / "relief_unknown.xml", write_moved_pole(folder)
    out = [
        Case("sphere and pole", pole, pole, pole),
        Case("a forgotten pole", pole, bare, bare),
        Case("a moved pole", pole, moved, moved),
        Case("square LEDs", soft, soft, soft),
        Case("two spheres", two, two, two),
        Case("relief", relief, unknown, relief),
    ]
    for name, file in MESHES.items():
        if (data_folder() / file).is_file():
            scene = write_mesh_scene(name, data_folder() / file, folder)
            out.append(Case(name, scene, unknown, scene))
    return out


def write_mesh_scene(name: str, file: Path, folder: Path) -> Path:
    """Write a scene with a mesh, scaled into the film."""
    ply, scene = write_scaled_mesh(file, folder / f"{name}.ply"), folder / f"{name}.xml"
    scene.write_text(f"""<scene version="3.0.0">
    <integrator type="ring"><float name="constant_light" value="0.05"/></integrator>
    <include filename="{SCENES / "camera.xml"}"/>
    <include filename="{SCENES / "ring24.xml"}"/>
    <shape type="ply" id="object"><string name="filename" value="{ply}"/>
        <bsdf type="diffuse"><spectrum name="reflectance" value="360:0.3, 500:0.4, 640:0.6, 830:0.6"/></bsdf></shape>
</scene>
""")
    return scene


def write_scaled_mesh(file: Path, ply: Path) -> Path:
    """Write a mesh anew, scaled into the film; gives its path."""
    mesh = trimesh.load(file, force="mesh", process=True)
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.apply_scale(1.05 / np.abs(mesh.bounds[:, :2]).max())
    ply.parent.mkdir(parents=True, exist_ok=True)
    mesh.export(ply, vertex_normal=True)
    return ply


def write_moved_pole(folder: Path) -> Path:
    """Write the sphere and its pole, which stands `MOVED` to the right of its place."""
    folder = folder / "moved_pole"
    copytree(SCENES, folder, dirs_exist_ok=True, ignore=ignore_patterns("*.py", "*.ply", "__pycache__"))
    text = (SCENES / "pole.xml").read_text()
    for x in (-0.28, -0.16):
        text = text.replace(f'x="{x}"', f'x="{x + MOVED:.2f}"')
    (folder / "pole.xml").write_text(text)
    return folder / "sphere_pole.xml"


def run(case: Case, size: int, ways: Sequence[str] = tuple(WAYS)) -> list[Result]:
    """Record once, fit in each of some ways; where `auto` finds hidden LEDs, it is `latent`."""
    recording, truth = evsdr.simulate(evsdr.load_scene(case.scene, size=size))
    shadow, recording = true_shadow(case.scene, truth, size), one_value(recording)
    results = {}
    for way in ways:
        if way == "latent" and "auto" in results and results["auto"].found is not None:
            results[way] = replace(results["auto"], way=way)
            continue
        scene = evsdr.load_scene(case.known if way == "scene" else case.told, size=size)
        with warnings.catch_warnings(), events_alone() if way == "events" else nullcontext():
            warnings.simplefilter("ignore", InputWarning)
            masked = way != "unmasked"
            fit = evsdr.fit(scene, recording, WAYS[way], truth.mask if masked else None)
        found = found_hidden(fit, shadow, truth) if masked else None
        seconds = sum(fit.summary["seconds"].values())
        results[way] = Result(way, fit.maps, truth, shadow.hidden, found, seconds)
    return list(results.values())


def events_alone() -> AbstractContextManager:
    """Let no geometry tell which LEDs are hidden: no shadow is traced, on none that is told nor on that of the fit."""
    from evsdr.effects import world  # which needs the backend

    find = world.find_visibility

    def asked(problem, solution, given, traced, known, *rest):
        return find(problem, solution, np.ones_like(given), None, False, *rest)

    return mock.patch.object(world, "find_visibility", asked)


def one_value(recording: Recording) -> Recording:
    """Tell the thresholds as a user's camera does: one value for all pixels."""
    sensor = recording.sensor
    mean = {name: float(np.mean(getattr(sensor, name))) for name in THRESHOLDS}
    return replace(recording, sensor=replace(sensor, **mean))


def true_shadow(scene: Path, truth: Truth, size: int) -> Shadow:
    """Trace what is hidden from each pixel."""
    ring = evsdr.load_scene(scene, size=size)
    from evsdr.light.tracing import trace_illumination

    plain, traced = (trace_illumination(ring, RAYS, shadows)[0] for shadows in (False, True))
    n_pixel = size * size
    direction = np.array([np.broadcast_to(np.array(d).T, (n_pixel, 3)) for d in plain.direction])
    visible = traced.share_of(plain, n_pixel)
    return Shadow(direction, n_hidden(visible, direction, truth.normal) * truth.mask)


def n_hidden(visible: np.ndarray, direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Count the LEDs that each pixel (H, W) faces and does not see, by visibility (n_led, n_pixel)."""
    faces = np.einsum("jnk,nk->jn", direction, normal.reshape(-1, 3)) > FACING
    return np.sum(faces & (visible < BLOCKED), axis=0).reshape(normal.shape[:2])


def found_hidden(fit: Fit, shadow: Shadow, truth: Truth) -> np.ndarray | None:
    """Count the same as the events told when they were first asked; None if that is not modelled."""
    decision = fit.decisions["cast shadows"]
    if not decision.modelled or decision.answer is None:
        return None
    pixel = np.flatnonzero(truth.mask)
    visible = decision.answer.everywhere(pixel, truth.mask.size)
    return n_hidden(visible, shadow.direction, fit.maps.normal)
