"""What the scene scripts write: meshes as PLY."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh.

    Attributes
    ----------
    position, normal : (n_vertex, 3) float
        Vertices and their unit normals.
    uv : (n_vertex, 2) float
        Texture coordinates.
    face : (n_face, 3) int
        Vertices of each triangle, anticlockwise as seen from outside.
    """

    position: np.ndarray
    normal: np.ndarray
    uv: np.ndarray
    face: np.ndarray


def write_ply(path: Path, mesh: Mesh) -> None:
    """Write a mesh as binary PLY with normals and texture coordinates, in single precision."""
    vertex = np.hstack([mesh.position, mesh.normal, mesh.uv]).astype("<f4")
    face = np.empty(len(mesh.face), [("n", "u1"), ("vertex_indices", "<i4", 3)])
    face["n"], face["vertex_indices"] = 3, mesh.face
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v")]
    header += [f"element face {len(face)}", "property list uchar int vertex_indices", "end_header", ""]
    path.write_bytes("\n".join(header).encode() + vertex.tobytes() + face.tobytes())
