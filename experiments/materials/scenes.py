"""What is recorded: materials that are not matt, and some that are, on a sphere and on sculptures of unknown shape."""

import os
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

REPOSITORY = Path(__file__).resolve().parents[2]
SCENES = REPOSITORY / "scenes"
SPECTRUM = 'value="360:0.10, 450:0.15, 520:0.30, 580:0.45, 650:0.55, 830:0.60"'
MATT = f'<bsdf type="diffuse"><spectrum name="reflectance" {SPECTRUM}/></bsdf>'
WHITE = '<bsdf type="diffuse"><spectrum name="reflectance" value="0.8"/></bsdf>'
WRAPS = {"translucent": 0.5, "slightly translucent": 0.3}
N_CELL = 48  # of the volume of patches, along each side
SIDE = 2.4  # of that volume, around the origin


def principled(**numbers: float) -> str:
    """Give a material with a matt base under something else."""
    parts = "".join(f'<float name="{name}" value="{value}"/>' for name, value in numbers.items())
    return f'<bsdf type="principled"><spectrum name="base_color" {SPECTRUM}/>{parts}</bsdf>'


def copper(roughness: float) -> str:
    """Give a metal."""
    kind = '<string name="material" value="Cu"/><string name="distribution" value="ggx"/>'
    return f'<bsdf type="roughconductor">{kind}<float name="alpha" value="{roughness}"/></bsdf>'


def patches(volume: Path) -> str:
    """Give a matt surface with patches of a coating, where a volume is 1."""
    place = (
        f'<transform name="to_world"><translate x="-.5" y="-.5" z="-.5"/><scale value="{SIDE}"/></transform>'
    )
    grid = (
        f'<volume name="volume" type="gridvolume"><string name="filename" value="{volume}"/>{place}</volume>'
    )
    weight = f'<texture type="volume" name="weight">{grid}</texture>'
    return f'<bsdf type="blendbsdf">{weight}{MATT}{principled(specular=0.7, roughness=0.45)}</bsdf>'


def write_patches(volume: Path) -> None:
    """Write which places are coated, as a volume of Mitsuba."""
    z, y, x = np.meshgrid(*3 * [(np.arange(N_CELL) + 0.5) / N_CELL - 0.5], indexing="ij")
    coated = np.sin(14 * z + 1) * np.sin(12 * y) + 0.3 * np.sin(9 * x) > 0
    head = struct.pack("<3sB5i6f", b"VOL", 3, 1, N_CELL, N_CELL, N_CELL, 1, 0, 0, 0, 1, 1, 1)
    volume.write_bytes(head + coated.astype("<f4").tobytes())


@dataclass(frozen=True)
class Case:
    """A recording to make and fit.

    Attributes
    ----------
    name : str
        Shape and material.
    true : Path
        The scene that is recorded.
    told : Path
        What the fit is told of it: the sphere, or no shape; of either a matt surface.
    wrap : float
        How far light goes on behind the horizon, R (n . l + wrap) / (1 + wrap), which Mitsuba has no material for.
    metal : bool
        Whether it has no matt part, so that nobody knows a true reflectance.
    """

    name: str
    true: Path
    told: Path
    wrap: float = 0.0
    metal: bool = False


def cases(folder: Path, meshes: Sequence[str] = ("goathead",)) -> Iterator[Case]:
    """Write the scenes into a folder, those of sculptures where their mesh is present."""
    write_patches(folder / "patches.vol")
    materials = {
        "matt": MATT,
        "matt white": WHITE,
        "coating": principled(specular=0.5, roughness=0.4),
        "patches of a coating": patches(folder / "patches.vol"),
        "copper 0.1": copper(0.1),
        "copper 0.2": copper(0.2),
        "copper 0.3": copper(0.3),
        **dict.fromkeys(WRAPS, MATT),
        "sheen": principled(specular=0.0, roughness=1.0, sheen=1.0),
        "sheen and coating": principled(sheen=1.0),
    }
    shapes = {"sphere": ('type="sphere"', '<float name="radius" value="0.95"/>')}
    for mesh in (data_folder() / f"{name}.obj" for name in meshes):
        if mesh.is_file():
            shapes[mesh.stem] = ('type="ply"', f'<string name="filename" value="{scaled(mesh, folder)}"/>')
    plane = '<transform name="to_world"><scale value="1.5"/></transform>'
    unknown = write(folder / "unknown.xml", 'type="rectangle"', plane + MATT)
    for shape, (kind, inside) in shapes.items():
        told = write(folder / "sphere.xml", kind, inside + MATT) if shape == "sphere" else unknown
        for material, bsdf in materials.items():
            name = f"{shape}, {material}"
            true = write(folder / f"{name.replace(' ', '_')}.xml", kind, inside + bsdf)
            yield Case(name, true, told, WRAPS.get(material, 0.0), material.startswith("copper"))


def write(path: Path, kind: str, inside: str) -> Path:
    """Write a scene of one object."""
    files = "".join(f'<include filename="{SCENES / name}.xml"/>' for name in ("camera", "ring24"))
    light = '<integrator type="ring"><float name="constant_light" value="0.05"/></integrator>'
    shape = f'<shape {kind} id="object">{inside}</shape>'
    path.write_text(f'<scene version="3.0.0">{light}{files}{shape}</scene>')
    return path


def scaled(mesh: Path, folder: Path) -> Path:
    """Write a mesh that fills the film."""
    shape = trimesh.load(mesh, force="mesh", process=True)
    shape.apply_translation(-shape.bounds.mean(axis=0))
    shape.apply_scale(1.05 / np.abs(shape.bounds[:, :2]).max())
    shape.export(folder / f"{mesh.stem}.ply", vertex_normal=True)
    return folder / f"{mesh.stem}.ply"


def data_folder() -> Path:
    """Say where the meshes should be: in $EVSDR_DATA, else in ../shared/data beside the repository."""
    return Path(os.environ.get("EVSDR_DATA") or REPOSITORY.parent / "shared/data") / "meshes"
