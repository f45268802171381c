"""Recordings with cast shadows, fitted in four ways; errors inside and outside of the shadow."""

import os
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

import evsdr
from evsdr import InputWarning, Maps, Settings, angular_error_deg

REPOSITORY = Path(__file__).resolve().parents[2]
SCENES = REPOSITORY / "scenes"
WAYS = ("off", "downweight", "estimate", "scene", "auto")
MESHES = {"nefertiti": "nefertiti-lowres.obj", "skull": "skull_low_resolution.obj"}
BLOCKED = 0.5  # visibility below which an LED counts as shadowed


@dataclass(frozen=True)
class Case:
    """A recording to make.

    Attributes
    ----------
    name : str
    scene : Path
        What is recorded.
    unknown : Path
        The scene for shadows `estimate`: where the shape is not told, or the same.
    """

    name: str
    scene: Path
    unknown: Path


@dataclass(frozen=True)
class Result:
    """What one way of fitting recovered.

    Attributes
    ----------
    way : str
        Of `WAYS`.
    error_deg : (H, W) float
        Angular error of the normals.
    rms : (H, W) float
        Root mean square error of the reflectance over the bands, per pixel.
    inside, outside : (H, W) bool
        Pixels of the truth in the shadow of some LED that they face, and the others.
    seconds : float
        Of the fit.
    maps : Maps
    """

    way: str
    error_deg: np.ndarray
    rms: np.ndarray
    inside: np.ndarray
    outside: np.ndarray
    seconds: float
    maps: Maps


def data_folder() -> Path:
    """Say where the meshes should be: in $EVSDR_DATA, else in ../shared/data beside the repository."""
    return Path(os.environ.get("EVSDR_DATA") or REPOSITORY.parent / "shared/data") / "meshes"


def cases(folder: Path) -> list[Case]:
    """List what can be recorded; scenes of meshes are written into the folder, where the meshes are present."""
    out = [
        Case("sphere and pole", SCENES / "sphere_pole.xml", SCENES / "sphere_pole.xml"),
        Case("square LEDs", SCENES / "soft_ring.xml", SCENES / "soft_ring.xml"),
        Case("relief", SCENES / "relief.xml", SCENES / "relief_unknown.xml"),
        Case("two spheres", SCENES / "two_spheres.xml", SCENES / "two_spheres.xml"),
    ]
    for name, file in MESHES.items():
        if (data_folder() / file).is_file():
            scene = write_mesh_scene(name, data_folder() / file, folder)
            out.append(Case(name, scene, scene))
    return out


def write_mesh_scene(name: str, file: Path, folder: Path) -> Path:
    """Write a scene with a mesh, scaled into the film."""
    mesh = trimesh.load(file, force="mesh", process=True)
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.apply_scale(1.05 / np.abs(mesh.bounds[:, :2]).max())
    folder.mkdir(parents=True, exist_ok=True)
    mesh.export(folder / f"{name}.ply", vertex_normal=True)
    scene = folder / f"{name}.xml"
    scene.write_text(f"""<scene version="3.0.0">
    <integrator type="ring"><float name="constant_light" value="0.05"/></integrator>
    <include filename="{SCENES / "camera.xml"}"/>
    <include filename="{SCENES / "ring24.xml"}"/>
    <shape type="ply" id="object"><string name="filename" value="{folder / f"{name}.ply"}"/>
        <bsdf type="diffuse"><spectrum name="reflectance" value="360:0.3, 500:0.4, 640:0.6, 830:0.6"/></bsdf></shape>
</scene>
""")
    return scene


def run(case: Case, size: int) -> list[Result]:
    """Record once, fit in each way."""
    recording, truth = evsdr.simulate(evsdr.load_scene(case.scene, size=size))
    inside = in_shadow(case.scene, size)
    results = []
    for way in WAYS:
        scene = evsdr.load_scene(case.unknown if way == "estimate" else case.scene, size=size)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            found = evsdr.fit(scene, recording, Settings(shadows=way))
        maps = found.maps
        mask = truth.mask & maps.mask
        results.append(
            Result(
                way,
                angular_error_deg(maps.normal, truth.normal),
                np.sqrt(np.mean((maps.reflectance - truth.reflectance) ** 2, axis=-1)),
                mask & inside,
                mask & ~inside,
                sum(found.summary["seconds"].values()),
                maps,
            )
        )
    return results


def in_shadow(scene: Path, size: int) -> np.ndarray:
    """Tell which pixels lie in the shadow of an LED that they face."""
    ring = evsdr.load_scene(scene, size=size)
    from evsdr.light.ground_truth import object_normals
    from evsdr.light.tracing import trace_illumination

    plain, _ = trace_illumination(ring, 4, False)
    traced, _ = trace_illumination(ring, 4, True)
    normal = object_normals(ring).reshape(-1, 3)
    out = np.zeros(len(normal), bool)
    for direction, free, lit in zip(plain.direction, plain.irradiance, traced.irradiance):
        faces = np.sum(normal * np.broadcast_to(np.array(direction).T, normal.shape), axis=-1) > 0.05
        out |= faces & (lit.numpy() < BLOCKED * free.numpy())
    return out.reshape(size, size)
