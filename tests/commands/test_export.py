"""Results are handed on from the command line: all files or none, and a sentence for what can't be."""

import json
import sys

import numpy as np
import pytest

import evsdr
from evsdr.commands.export import main
from tests.support.page_fits import make_fit
from tests.support.saved_fits import save

FILES = {
    "envi": {"reflectance.hdr", "reflectance.img", "reflectance_sigma.hdr", "reflectance_sigma.img"},
    "openlime": {"index.html", "colour.png", "normals.png", "info.json", "presets.json", "bands_00.jpg"},
    "gltf": {"surface.glb"},
    "tiff": {
        f"{name}.tif" for name in ("normal", "normal_sigma_deg", "reflectance", "reflectance_sigma", "depth")
    },
    "csv": {"pixels.csv"},
}


@pytest.fixture
def results(commands):
    return save(commands.folder / "fit", make_fit())


@pytest.mark.parametrize("kind", FILES)
def test_all_files_are_written_beside_the_results(commands, results, kind):
    status, out, err = commands.run(main, results, "--to", kind)
    assert (status, err) == (0, "")
    assert {file.name for file in (results / kind).iterdir()} == FILES[kind]
    assert all(name in out for name in FILES[kind])
    evsdr.read_results(results)  # which are as they were


def test_a_unit_that_is_told_wins(commands, results):
    header = []
    for unit in ((), ("--unit", "m")):
        assert commands.run(main, results, "--to", "csv", "--out", commands.folder / "table", *unit)[0] == 0
        header.append(np.genfromtxt(commands.folder / "table" / "pixels.csv", delimiter=",", names=True))
    np.testing.assert_allclose(header[1]["z_mm"], 100 * header[0]["z_mm"], rtol=1e-6)


def test_a_fit_is_handed_on(commands):
    """From the scene's unit to millimetres; one without says so."""
    path = commands.folder / "scene.xml"
    assert commands.fit("--no-report")[0] == 0
    status, _, err = commands.run(main, commands.folder / "out", "--to", "csv")
    assert status == 0 and "nobody tells how long" in err
    plain = np.genfromtxt(commands.folder / "out" / "csv" / "pixels.csv", delimiter=",", names=True)
    path.write_text(path.read_text().replace('type="ring">', 'type="ring"><string name="unit" value="cm"/>'))
    assert commands.fit("--no-report")[0] == 0
    assert json.loads((commands.folder / "out" / "summary.json").read_text())["unit"] == "cm"
    status, _, err = commands.run(main, commands.folder / "out", "--to", "csv")
    assert (status, err) == (0, "")
    table = np.genfromtxt(commands.folder / "out" / "csv" / "pixels.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["x_mm"], 10 * plain["x_scene"], rtol=1e-6)
    radius = np.hypot(table["x_mm"], table["y_mm"])
    assert (
        7 < radius.max() < 11
    )  # a sphere of 1 cm; pixels of 0.2 cm that it covers in part have their centres outside
    np.testing.assert_allclose(table["z_mm"].max(), -30, atol=1.5)  # 4 cm before the camera


def test_a_wrong_unit_of_the_scene_is_a_sentence(commands):
    path = commands.folder / "scene.xml"
    path.write_text(
        path.read_text().replace('type="ring">', 'type="ring"><string name="unit" value="inch"/>')
    )
    assert "unit must be one of um, mm, cm, m, got inch" in commands.fit_refused()


def test_what_is_no_fit_is_refused(commands, results):
    assert "absent" in commands.refused(main, commands.folder / "absent", "--to", "envi")
    (results / "depth.exr").write_bytes(b"no")
    assert "depth.exr: this is not the file" in commands.refused(main, results, "--to", "envi")


def test_a_workspace_of_colmap_needs_perspective(commands, results):
    assert "orthographic" in commands.refused(main, results, "--to", "colmap")


def test_a_missing_library_leaves_nothing(commands, results, monkeypatch):
    monkeypatch.setitem(sys.modules, "tifffile", None)
    sentence = commands.refused(main, results, "--to", "tiff")
    assert "tifffile is not installed" in sentence


def test_a_folder_that_cant_be_written_is_refused(commands, results):
    (commands.folder / "file").write_text("")
    assert "file" in commands.refused(main, results, "--to", "gltf", "--out", commands.folder / "file")
