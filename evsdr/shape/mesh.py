"""A triangle mesh of a depth map, with the fitted normals and colours, as PLY."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.atomic import atomic_path
from evsdr.shape.depth import Depth

STEP_DEG = 60.0  # between a triangle and its corners' normals, from which it spans a depth discontinuity


@dataclass(frozen=True)
class SurfaceMesh:
    """A triangle mesh whose vertices are the pixels of the depth map's mask, in row order.

    Attributes
    ----------
    position : (n_vertex, 3) float64
        Surface points [scene units].
    normal : (n_vertex, 3) float64
        Unit normals, those given: not those of the triangles.
    colour : (n_vertex, 3) uint8 or None
        sRGB.
    face : (n_face, 3) int64
        Vertices of each triangle, anticlockwise as seen from the camera.
    """

    position: np.ndarray
    normal: np.ndarray
    colour: np.ndarray | None
    face: np.ndarray


def make_mesh(
    depth: Depth,
    normal: np.ndarray,
    colour: np.ndarray | None = None,
    to_world: np.ndarray | None = None,
    bridge: bool = False,
) -> SurfaceMesh:
    """Triangulate a depth map.

    Four neighbouring pixels make two triangles, cut along their shorter diagonal; three of four make one.

    Parameters
    ----------
    depth : Depth
    normal : (H, W, 3) float
        Normals in the camera frame: x right, y up, z toward the camera.
    colour : (H, W, 3) float, optional
        sRGB, 0..1, as from `daylight.reflectance_to_srgb`.
    to_world : (4, 4) float, optional
        Rigid transformation from the camera frame; by default the mesh stays in the camera frame.
    bridge : bool
        Keep triangles across depth discontinuities, as walls along the lines of sight. Without them light
        leaks through the gaps; with them a shadow is never too small. False leaves out triangles more than
        60 degrees off their corners' normals.

    Returns
    -------
    SurfaceMesh
        Components of the depth map stay apart: no triangle joins them.

    Raises
    ------
    InputError
        Shapes differ.
    """
    mask = depth.mask
    for name, image in (("normal", normal), ("colour", colour)):
        if image is not None and np.shape(image) != (*mask.shape, 3):
            raise InputError(
                f"{name} has shape {np.shape(image)}; make it {(*mask.shape, 3)}, like the depth."
            )
    to_world = np.eye(4) if to_world is None else np.asarray(to_world, float)
    if to_world.shape != (4, 4):
        raise InputError(f"to_world has shape {to_world.shape}; make it (4, 4).")
    position = depth.points[mask]
    normal = np.asarray(normal, float)[mask]
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    face = _triangles(position, mask)
    if not bridge:
        face = face[_follows(position, normal, face)]
    rotation, origin = to_world[:3, :3], to_world[:3, 3]
    if colour is not None:
        colour = np.round(255 * np.clip(np.asarray(colour, float)[mask], 0, 1)).astype(np.uint8)
    return SurfaceMesh(position @ rotation.T + origin, normal @ rotation.T, colour, face)


def _triangles(position: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Give all triangles between neighbouring pixels of the mask."""
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(len(position))
    a, b, c, d = (
        index[:-1, :-1].ravel(),
        index[:-1, 1:].ravel(),
        index[1:, :-1].ravel(),
        index[1:, 1:].ravel(),
    )
    falling, rising = (np.sum((position[i] - position[j]) ** 2, axis=-1) for i, j in ((a, d), (b, c)))
    along_falling = np.where((a >= 0) & (d >= 0), (b < 0) | (c < 0) | (falling <= rising), False)[:, None]
    first = np.where(along_falling, np.stack([a, c, d], axis=-1), np.stack([a, c, b], axis=-1))
    second = np.where(along_falling, np.stack([a, d, b], axis=-1), np.stack([c, d, b], axis=-1))
    face = np.stack([first, second], axis=1).reshape(-1, 3)
    return face[(face >= 0).all(axis=-1)]


def _follows(position: np.ndarray, normal: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Tell which triangles follow their corners' normals."""
    corner = position[face]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    mean = normal[face].sum(axis=1)
    cosine = np.einsum("fk,fk->f", across, mean)
    length = np.linalg.norm(across, axis=-1) * np.linalg.norm(mean, axis=-1)
    return cosine >= np.cos(np.radians(STEP_DEG)) * length


def write_mesh(path: str | Path, mesh: SurfaceMesh) -> None:
    """Write a binary PLY with normals, and colours if there are any.

    Raises
    ------
    InputError
        The file can't be written.
    """
    columns = {"x y z": (mesh.position, "<f4", "float"), "nx ny nz": (mesh.normal, "<f4", "float")}
    if mesh.colour is not None:
        columns["red green blue"] = mesh.colour, "u1", "uchar"
    kinds = [(name, kind) for names, (_, kind, _) in columns.items() for name in names.split()]
    vertex = np.empty(len(mesh.position), kinds)
    for names, (values, *_) in columns.items():
        for name, column in zip(names.split(), values.T):
            vertex[name] = column
    face = np.empty(len(mesh.face), [("n", "u1"), ("corner", "<i4", 3)])
    face["n"], face["corner"] = 3, mesh.face
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertex)}",
        *(f"property {word} {name}" for names, (*_, word) in columns.items() for name in names.split()),
        f"element face {len(face)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    data = "\n".join(header).encode() + vertex.tobytes() + face.tobytes()
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)
