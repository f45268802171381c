"""A triangle mesh of a depth map, with the fitted normals and colours, as PLY."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.atomic import atomic_path
from evsdr.shape.depth import Depth
from evsdr.shape.laplacian import ends


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

    Returns
    -------
    SurfaceMesh
        No triangle joins neighbours that are not tied: depth jumps there.

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
    face = _triangles(position, mask, depth.tied)
    rotation, origin = to_world[:3, :3], to_world[:3, 3]
    if colour is not None:
        colour = np.round(255 * np.clip(np.asarray(colour, float)[mask], 0, 1)).astype(np.uint8)
    return SurfaceMesh(position @ rotation.T + origin, normal @ rotation.T, colour, face)


def _triangles(position: np.ndarray, mask: np.ndarray, tied: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Give all triangles between neighbouring pixels of the mask whose sides along rows and columns are tied."""
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(len(position))
    (a, b), (c, d) = ([corner.ravel() for corner in ends(row, 1)] for row in ends(index, 0))
    rows, columns = (tie & np.logical_and(*ends(mask, axis)) for axis, tie in enumerate(tied))
    (left, right), (upper, lower) = ends(rows, 1), ends(columns, 0)
    falling = [(left & lower).ravel(), (upper & right).ravel()]  # along the diagonal from a to d
    rising = [(left & upper).ravel(), (lower & right).ravel()]
    more = np.sum(falling, axis=0) - np.sum(rising, axis=0)
    across, along = (np.sum((position[i] - position[j]) ** 2, axis=-1) for i, j in ((b, c), (a, d)))
    cut = np.where(more == 0, along <= across, more > 0)
    corners = (a, c, d), (a, d, b), (a, c, b), (c, d, b)
    whole = [f & cut for f in falling] + [r & ~cut for r in rising]
    face = np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1)
    return face[np.stack(whole, axis=1)]


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
