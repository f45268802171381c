"""Reference tables and the absolute scale, as the command finds and writes them."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from evsdr.calibration.chart import (
    PatchTable,
    chart_labels,
    choose,
    find_scale,
    read_patches,
    write_patches,
)
from evsdr.commands import calibrate
from evsdr.errors import InputError
from evsdr.files.results import write_results
from evsdr.light.camera import view_of
from evsdr.light.ground_truth import surface_maps
from evsdr.light.scene import load_scene
from evsdr.model.quadrature import WAVELENGTH_NM
from evsdr.records import Maps

SCENES = Path(__file__).resolve().parents[2] / "scenes"


BANDS = np.exp(-0.5 * ((WAVELENGTH_NM - np.array([[450.0], [550.0], [650.0]])) / 12) ** 2)


def test_projection_agrees_with_the_renderer(tmp_path):
    """Twelve patches and eight bands, as the renderer integrates the same spectra for the chart's scene."""
    assert calibrate.main(["reference", str(SCENES / "colorchecker.xml"), "--out", str(tmp_path)]) == 0
    table = read_patches(tmp_path / "reference.csv")
    assert table.value.shape == (12, 8)
    assert read_patches(tmp_path / "reserved.csv").name == ["white 9.5 (.05 D)"]
    ring = load_scene(SCENES / "colorchecker.xml", {"size": "48"})
    truth = surface_maps(ring, 4)
    label = chart_labels(chart_corners(ring), (48, 48), gap=1 / 7)
    for number, value in zip(table.number, table.value):
        seen = truth.reflectance[(label == number) & truth.mask]
        assert len(seen) > 4
        np.testing.assert_allclose(seen.mean(axis=0), value, atol=0.004)


def chart_corners(ring) -> np.ndarray:
    """Give the chart's corners in the image: 1.96 x 1.32, turned by 15 degrees about (0.8, 0.6, 0)."""
    turn = Rotation.from_rotvec(np.radians(15) * np.array([0.8, 0.6, 0])).as_matrix()
    corner = np.array([(-0.98, 0.66, 0), (0.98, 0.66, 0), (0.98, -0.66, 0), (-0.98, -0.66, 0)]) @ turn.T
    view = view_of(ring)
    return view.project(view.point_to_camera(corner))


def make_maps(label: np.ndarray, table: PatchTable, factor: float, noise: float) -> Maps:
    rng = np.random.default_rng(3)
    reflectance = np.zeros((*label.shape, 3))
    for number, value in zip(table.number, table.value):
        reflectance[label == number] = factor * value
    reflectance += rng.normal(0, noise, reflectance.shape)
    normal = np.broadcast_to([0.0, 0.0, 1.0], reflectance.shape)
    fields = (
        normal,
        reflectance,
        label > 0,
        np.ones(label.shape),
        np.full(reflectance.shape, noise),
        table.band_nm,
    )
    return Maps(*(np.asarray(f, bool if f is fields[2] else np.float32) for f in fields))


@pytest.fixture
def chart(tmp_path):
    rng = np.random.default_rng(8)
    label = np.repeat(np.arange(1, 14), 40).reshape(26, 20)
    table = PatchTable(
        [f"p{k}" for k in range(1, 14)],
        np.arange(1, 14),
        np.array([450.0, 550.0, 650.0]),
        rng.uniform(0.1, 0.9, (13, 3)),
        np.full((13, 3), 1e-4),
    )
    write_patches(tmp_path / "reference.csv", choose(table, [str(k) for k in range(1, 13)]))
    write_patches(tmp_path / "reserved.csv", choose(table, ["13"]))
    np.save(tmp_path / "labels.npy", label)
    write_results(tmp_path / "fit", make_maps(label, table, 0.8, 0.01), {})
    return tmp_path, label, table


def test_scale_from_one_patch_and_evaluation_on_twelve(chart, capsys):
    folder, label, table = chart
    arguments = ["scale", str(folder / "fit" / "maps.npz"), "--labels", str(folder / "labels.npy")]
    arguments += ["--reference", str(folder / "reference.csv"), "--reserved", str(folder / "reserved.csv")]
    out = folder / "out"
    assert calibrate.main([*arguments, "--constant-light", "0.04", "--out", str(out)]) == 0
    said = json.loads((out / "calibration.json").read_text())
    scale, sigma = said["scale"]["value"], said["scale"]["sigma"]
    assert abs(scale - 1.25) < 3 * sigma and 0 < sigma < 0.01
    assert said["constant_light"]["value"] == pytest.approx(0.04 * scale)
    assert len(said["patches"]) == 12 and all(
        0 < p["rmse"] < 0.02 and p["sam_deg"] < 2 for p in said["patches"]
    )
    root = ET.parse(out / "constant_light.xml").getroot()
    assert float(root.find("default").get("value")) == pytest.approx(0.04 * scale, rel=1e-5)
    with pytest.raises(InputError, match="bands at"):
        other = PatchTable(table.name, table.number, table.band_nm + 20, table.value, table.sigma)
        find_scale(make_maps(label, table, 1, 0), label, choose(other, ["13"]), other)
    with pytest.raises(InputError, match=r"patch 2 \(p2\) has 0 known pixels"):
        find_scale(
            make_maps(label, table, 1, 0), np.where(label == 2, 0, label), choose(table, ["13"]), table
        )
    assert calibrate.main(arguments[:2] + arguments[4:] + ["--out", str(folder / "no")]) == 2
    assert "give --corners or --labels" in capsys.readouterr().err
