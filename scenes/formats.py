"""What the scene scripts write: spectra as Mitsuba XML, meshes as PLY."""

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


def spectrum_xml(wavelength_nm: np.ndarray, value: np.ndarray, **attribute: str) -> str:
    """Write a spectrum of regularly spaced samples as one XML element.

    Parameters
    ----------
    wavelength_nm : (n,) float
        Regularly spaced wavelengths [nm].
    value : (n,) float
        Samples; linear in between, zero outside.
    **attribute : str
        Attributes of the element: `id` or `name`.

    Returns
    -------
    str
        Element without indentation, one child a line.
    """
    named = "".join(f' {key}="{text}"' for key, text in attribute.items())
    return (
        f'<spectrum type="regular"{named}>\n'
        f'    <float name="wavelength_min" value="{wavelength_nm[0]:g}"/>\n'
        f'    <float name="wavelength_max" value="{wavelength_nm[-1]:g}"/>\n'
        f'    <string name="values" value="{" ".join(f"{v:.6g}" for v in value)}"/>\n'
        "</spectrum>"
    )


def write_ply(path: Path, mesh: Mesh) -> None:
    """Write a mesh as binary PLY with normals and texture coordinates, in single precision."""
    vertex = np.hstack([mesh.position, mesh.normal, mesh.uv]).astype("<f4")
    face = np.empty(len(mesh.face), [("n", "u1"), ("vertex_indices", "<i4", 3)])
    face["n"], face["vertex_indices"] = 3, mesh.face
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v")]
    header += [f"element face {len(face)}", "property list uchar int vertex_indices", "end_header", ""]
    path.write_bytes("\n".join(header).encode() + vertex.tobytes() + face.tobytes())
