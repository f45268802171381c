"""The surface as glTF 2.0, `.glb`: a matt material with colour, and the fitted normals as normal map."""

import tempfile
from pathlib import Path

import numpy as np

from evsdr import __version__
from evsdr.errors import InputError
from evsdr.exports.glb import Buffer, write_glb
from evsdr.exports.source import Source
from evsdr.files.daylight import reflectance_to_srgb
from evsdr.files.results import encode_normal, write_png

LEAST_COSINE = 0.2  # of fitted and integrated normal; guessed: beyond that the vertex takes the fitted one
LINEAR, CLAMP = 9729, 33071  # filter and wrap of a sampler


def write_gltf(folder: Path, source: Source) -> None:
    """Write `surface.glb` in the camera frame [m], or [scene units] where nobody tells how long these are.

    Vertices are pixels. Their normals are those of the triangles; the normal map turns them into the fitted ones.

    Raises
    ------
    InputError
        No three known pixels make a triangle.
    """
    if not len(source.face):
        raise InputError("no three neighbouring pixels are known, so there is no surface; take --to csv.")
    maps, mask = source.maps, source.maps.mask
    normal, tangent = frames(source)
    used, face = np.unique(source.face, return_inverse=True)
    row, column = np.nonzero(mask)
    height, width = mask.shape
    buffer = Buffer()
    attributes = {
        "POSITION": source.points[mask] * (1e-3 if source.unit == "mm" else 1),
        "NORMAL": normal,
        "TANGENT": np.concatenate([tangent, np.ones((len(tangent), 1))], axis=1),
        "TEXCOORD_0": np.stack([(column + 0.5) / width, (row + 0.5) / height], axis=1),
    }
    primitive = {
        "attributes": {name: buffer.attribute(values[used]) for name, values in attributes.items()},
        "indices": buffer.corners(face.reshape(-1, 3)),
        "material": 0,
    }
    colour = np.round(255 * reflectance_to_srgb(maps.reflectance, maps.band_wavelength_nm)).astype(np.uint8)
    pictures = colour, encode_normal(normal_map(maps.normal, mask, normal, tangent), mask)
    images = [{"bufferView": buffer.view(_png(picture)), "mimeType": "image/png"} for picture in pictures]
    write_glb(folder / "surface.glb", _document(primitive, images, source.unit), buffer)


def frames(source: Source) -> tuple[np.ndarray, np.ndarray]:
    """Give normals and tangents (n, 3) of the surface at the known pixels; tangents point to the right of the image."""
    mask, face = source.maps.mask, source.face
    fitted, position = np.asarray(source.maps.normal[mask], float), source.points[mask]
    a, b, c = (position[face[:, k]] for k in range(3))
    normal = np.zeros_like(position)
    for k in range(3):
        np.add.at(normal, face[:, k], np.cross(b - a, c - a))
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    fits = np.sum(normal * fitted, axis=1, keepdims=True) > LEAST_COSINE
    normal = np.where(fits, normal, fitted)
    tangent = np.array([1.0, 0, 0]) - normal[:, :1] * normal
    return normal, tangent / np.linalg.norm(tangent, axis=1, keepdims=True)


def normal_map(fitted: np.ndarray, mask: np.ndarray, normal: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Give fitted normals (H, W, 3) in the frames of the vertices: tangent, bitangent (up), normal."""
    axes = np.stack([tangent, np.cross(normal, tangent), normal], axis=1)
    turned = np.zeros(fitted.shape)
    turned[mask] = np.einsum("nij,nj->ni", axes, fitted[mask])
    return turned


def _png(picture: np.ndarray) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write_png(Path(folder) / "picture.png", picture)
        return (Path(folder) / "picture.png").read_bytes()


def _document(primitive: dict, images: list[dict], unit: str) -> dict:
    material = {
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0},
            "metallicFactor": 0,
            "roughnessFactor": 1,
        },
        "normalTexture": {"index": 1},
        "doubleSided": True,
    }
    unit = "metre" if unit == "mm" else "unit of the scene"
    return {
        "asset": {"version": "2.0", "generator": f"evsdr {__version__}", "extras": {"unit": unit}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "surface"}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [material],
        "samplers": [{"magFilter": LINEAR, "minFilter": LINEAR, "wrapS": CLAMP, "wrapT": CLAMP}],
        "textures": [{"source": k, "sampler": 0} for k in range(len(images))],
        "images": images,
    }
