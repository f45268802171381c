"""The surface as glTF: opened by trimesh, and its normal map turned back into the fitted normals."""

import io
from dataclasses import replace

import numpy as np
import png
import pytest
import trimesh

from evsdr.errors import InputError
from evsdr.exports.gltf import frames, write_gltf
from evsdr.exports.source import read_source
from evsdr.files.daylight import reflectance_to_srgb
from tests.support.glb_file import accessor, read_glb


@pytest.fixture
def source(results):
    return read_source(results)


def vertices(source):
    """Which of the known pixels are vertices of a triangle."""
    return np.unique(source.face)


def test_trimesh_opens_it(source, fit, tmp_path):
    write_gltf(tmp_path, source)
    (mesh,) = trimesh.load(tmp_path / "surface.glb", process=False).geometry.values()
    mask, used = fit.maps.mask, vertices(source)
    np.testing.assert_allclose(mesh.vertices, 0.01 * fit.depth.points[mask][used], rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(used[mesh.faces], source.face)
    assert (mesh.face_normals[:, 2] > 0).all()  # seen from the camera
    material = mesh.visual.material
    colour = np.asarray(material.baseColorTexture)
    expected = 255 * reflectance_to_srgb(source.maps.reflectance, source.maps.band_wavelength_nm)
    np.testing.assert_allclose(colour[mask], expected[mask], atol=0.51)
    assert material.normalTexture.size == mask.shape[::-1] and material.metallicFactor == 0
    row, column = np.argwhere(mask)[used].T
    height, width = mask.shape
    np.testing.assert_allclose(mesh.visual.uv[:, 0], (column + 0.5) / width, rtol=1e-6)
    np.testing.assert_allclose(mesh.visual.uv[:, 1], 1 - (row + 0.5) / height, rtol=1e-5)


def test_normal_map_gives_the_fitted_normals(source, fit, tmp_path):
    write_gltf(tmp_path, source)
    document, data = read_glb(tmp_path / "surface.glb")
    primitive = document["meshes"][0]["primitives"][0]
    found = {name: accessor(document, data, index) for name, index in primitive["attributes"].items()}
    texture = document["textures"][document["materials"][0]["normalTexture"]["index"]]
    view = document["bufferViews"][document["images"][texture["source"]]["bufferView"]]
    picture = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    width, height, rows, about = png.Reader(file=io.BytesIO(picture)).read()
    texel = np.vstack([np.asarray(row) for row in rows]).reshape(height, width, 3) / 65535
    assert about["bitdepth"] == 16
    at = np.round(found["TEXCOORD_0"] * [width, height] - 0.5).astype(int)
    local = 2 * texel[at[:, 1], at[:, 0]] - 1
    normal, tangent = found["NORMAL"], found["TANGENT"]
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(tangent[:, :3], axis=1), 1, rtol=1e-5)
    np.testing.assert_allclose(np.sum(normal * tangent[:, :3], axis=1), 0, atol=1e-6)
    bitangent = tangent[:, 3:] * np.cross(normal, tangent[:, :3])
    shown = local[:, :1] * tangent[:, :3] + local[:, 1:2] * bitangent + local[:, 2:] * normal
    np.testing.assert_allclose(shown, fit.maps.normal[fit.maps.mask][vertices(source)], atol=1e-4)
    assert (local[:, 2] > 0).all() and np.abs(local[:, :2]).max() > 0.05  # the map tells something


def test_lengths_without_a_unit_are_those_of_the_scene(source, tmp_path):
    write_gltf(tmp_path, replace(source, unit="scene"))
    document, data = read_glb(tmp_path / "surface.glb")
    position = accessor(document, data, 0)
    np.testing.assert_allclose(position, source.points[source.maps.mask][vertices(source)], rtol=1e-6)
    assert document["asset"]["extras"]["unit"] == "unit of the scene"


def test_a_fitted_normal_that_contradicts_the_surface_wins(source):
    normal = source.maps.normal.copy()
    pixel = tuple(np.argwhere(source.maps.mask)[source.face[0, 0]])
    normal[pixel] = (1 - 1e-6, 0, 1e-3)
    turned, tangent = frames(replace(source, maps=replace(source.maps, normal=normal)))
    np.testing.assert_allclose(turned[source.face[0, 0]], normal[pixel])
    assert np.isfinite(tangent).all()


def test_single_pixels_make_no_surface(source, tmp_path):
    with pytest.raises(InputError, match="no surface"):
        write_gltf(tmp_path, replace(source, face=source.face[:0]))
