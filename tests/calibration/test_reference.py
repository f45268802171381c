"""Reference reflectance, absolute scale, poses of CAD models, and scene files as text."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from evsdr.calibration.chart import (
    Spectra,
    Table,
    chart_labels,
    choose,
    find_scale,
    over_white,
    project,
    read_spectra,
    read_table,
    write_table,
)
from evsdr.calibration.pose import Evidence, find_pose, read_model
from evsdr.calibration.scene_text import find_leds, flatten, include_text, place_led, scale_led
from evsdr.commands import calibrate
from evsdr.errors import InputError, InputWarning
from evsdr.files.results import write_results
from evsdr.light.camera import view_of
from evsdr.light.ground_truth import surface_maps
from evsdr.light.scene import load_scene
from evsdr.light.tracing import trace_illumination
from evsdr.metrics import angular_error_deg
from evsdr.model.quadrature import WAVELENGTH_NM
from evsdr.model.view import pixel_centers
from evsdr.records import Maps
from tests.support.small_scene import scene

SCENES = Path(__file__).resolve().parents[2] / "scenes"
BANDS = np.exp(-0.5 * ((WAVELENGTH_NM - np.array([[450.0], [550.0], [650.0]])) / 12) ** 2)


def test_projection_of_a_line_and_of_noise(rng):
    """A line is projected on the band's centroid; sigma is the scatter over noisy copies."""
    nm = np.arange(380.0, 731.0, 5.0)
    line = (nm - 300) / 1000
    table = project(Spectra(["line"], nm, line[None]), BANDS)
    np.testing.assert_allclose(table.band_nm, [450, 550, 650], atol=1e-6)
    np.testing.assert_allclose(table.value[0], [0.15, 0.25, 0.35], atol=1e-6)
    noisy = line + rng.normal(0, 0.01, (300, len(nm)))
    table = project(Spectra([str(k) for k in range(300)], nm, noisy), BANDS)
    np.testing.assert_allclose(table.value.std(axis=0), np.median(table.sigma, axis=0), rtol=0.15)


def test_projection_agrees_with_the_renderer(tmp_path):
    """Twelve patches and eight bands, as the renderer integrates the same spectra for the chart's scene."""
    assert calibrate.main(["reference", str(SCENES / "colorchecker.xml"), "--out", str(tmp_path)]) == 0
    table = read_table(tmp_path / "reference.csv")
    assert table.value.shape == (12, 8)
    assert read_table(tmp_path / "reserved.csv").name == ["white 9.5 (.05 D)"]
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


def test_white_patch_divides_out_the_light(tmp_path):
    nm = np.arange(400.0, 701.0, 10.0)
    light = 3 + np.sin(nm / 50)
    (tmp_path / "s.csv").write_text(
        "wavelength_nm,a,white\n" + "".join(f"{w},{0.3 * i},{0.9 * i}\n" for w, i in zip(nm, light))
    )
    found = over_white(read_spectra(str(tmp_path / "s.csv")), "white", 0.9)
    assert found.name == ["a"]
    np.testing.assert_allclose(found.value, 0.3, atol=1e-12)
    with pytest.raises(InputError, match="no column has that name; there are a, white"):
        over_white(read_spectra(str(tmp_path / "s.csv")), "grey", 1.0)


@pytest.mark.parametrize(
    "text, says",
    [
        ("a,b\n0.1,0.2\n0.1,0.2\n0.1,0.2\n0.1,0.2\n", "first column is named 'a', not wavelength_nm"),
        ("wavelength_nm,b\n400,1\n390,1\n410,1\n420,1\n", "must grow line by line"),
        ("wavelength_nm,b\n400,1\n410,x\n", "not a readable table"),
        ("wavelength_nm,b\n400,1\n410\n", "not a readable table"),
        ("wavelength_nm,b\n400,1\n410,nan\n420,1\n430,1\n", "no finite numbers"),
        ("", "not a readable table"),
    ],
)
def test_spectra_that_can_not_be_used_are_refused(tmp_path, text, says):
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_spectra(str(tmp_path / "s.csv"))


def test_bands_beyond_the_spectra(tmp_path):
    nm = np.arange(400.0, 651.0, 10.0)
    with pytest.raises(InputError, match="band at 650 nm lies outside of the measured 400 to 650"):
        project(Spectra(["a"], nm, np.full((1, len(nm)), 0.5)), BANDS)
    nm = np.arange(400.0, 681.0, 10.0)
    with pytest.warns(InputWarning, match="taken as constant"):
        project(Spectra(["a"], nm, np.full((1, len(nm)), 0.5)), BANDS)
    with pytest.raises(InputError, match="give shares of 1"):
        project(Spectra(["a"], nm, np.full((1, len(nm)), 50.0)), BANDS)


def test_tables_survive_the_file(tmp_path, rng):
    value = rng.random((2, 3))
    table = Table(["red, dark", "b"], np.array([3, 7]), np.array([450.0, 550.0, 650.0]), value, 0.01 * value)
    write_table(tmp_path / "t.csv", table)
    back = read_table(tmp_path / "t.csv")
    assert back.name == table.name
    np.testing.assert_array_equal(back.number, table.number)
    np.testing.assert_allclose(back.value, value, atol=1e-6)
    np.testing.assert_allclose(back.sigma, 0.01 * value, rtol=0.1)
    assert choose(back, ["7"]).name == ["b"]
    with pytest.raises(InputError, match="no patch is called c"):
        choose(back, ["c"])


def test_chart_labels_of_a_tilted_chart():
    """A chart of 2 x 3 patches seen from aside: labels lie in their own patch."""
    corner = np.array([(10.0, 12.0), (80.0, 20.0), (70.0, 75.0), (15.0, 60.0)])
    label = chart_labels(corner, (90, 100), n_row=2, n_column=3)
    assert set(np.unique(label)) == set(range(7))
    row, column = np.indices(label.shape)
    centre = [(column[label == k].mean(), row[label == k].mean()) for k in range(1, 7)]
    assert np.linalg.norm(centre[0] - corner[0]) < 25 and np.linalg.norm(centre[2] - corner[1]) < 25
    assert np.linalg.norm(centre[5] - corner[2]) < 25 and np.linalg.norm(centre[3] - corner[3]) < 25
    with pytest.raises(InputError, match="not the corners of a chart"):
        chart_labels(corner[[0, 2, 1, 3]], (90, 100))


def make_maps(label: np.ndarray, table: Table, factor: float, noise: float) -> Maps:
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
    table = Table(
        [f"p{k}" for k in range(1, 14)],
        np.arange(1, 14),
        np.array([450.0, 550.0, 650.0]),
        rng.uniform(0.1, 0.9, (13, 3)),
        np.full((13, 3), 1e-4),
    )
    write_table(tmp_path / "reference.csv", choose(table, [str(k) for k in range(1, 13)]))
    write_table(tmp_path / "reserved.csv", choose(table, ["13"]))
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
        other = Table(table.name, table.number, table.band_nm + 20, table.value, table.sigma)
        find_scale(make_maps(label, table, 1, 0), label, choose(other, ["13"]), other)
    with pytest.raises(InputError, match=r"patch 2 \(p2\) has 0 known pixels"):
        find_scale(
            make_maps(label, table, 1, 0), np.where(label == 2, 0, label), choose(table, ["13"]), table
        )
    assert calibrate.main(arguments[:2] + arguments[4:] + ["--out", str(folder / "no")]) == 2
    assert "give --corners or --labels" in capsys.readouterr().err


@pytest.fixture(scope="module")
def blob():
    """The blob as its scene shows it, and its mesh."""
    ring = load_scene(SCENES / "blob.xml", {"size": "96"})
    _, coverage = trace_illumination(ring, 16, False)
    truth = surface_maps(ring, 4)
    mesh, model = read_model(SCENES / "blob.ply", 1.0)
    return view_of(ring), coverage >= 0.5, truth, mesh, model


@pytest.fixture(scope="module")
def points(blob):
    """Ten picked points, 0.3 pixels wrong."""
    view, _, _, mesh, _ = blob
    rng = np.random.default_rng(0)
    point = mesh.vertices[rng.choice(len(mesh.vertices), 10)]
    return view.project(view.point_to_camera(point)) + rng.normal(0, 0.3, (10, 2)), point


def turned(model, turn: np.ndarray):
    """Turn a mesh about its middle, so that its file is no start."""
    from dataclasses import replace

    names = ("vertex", "normal", "face_normal")
    return replace(model, **{name: getattr(model, name) @ turn.T for name in names})


@pytest.mark.parametrize("with_normals, bound_deg", [(False, 1.0), (True, 0.15)])
def test_pose_from_a_silhouette(blob, with_normals, bound_deg):
    view, mask, truth, _, model = blob
    turn = Rotation.from_euler("xyz", [12, -15, 10], degrees=True).as_matrix()
    evidence = Evidence(mask=mask, normal=truth.normal * truth.mask[..., None] if with_normals else None)
    found = find_pose(view, turned(model, turn), evidence, 10.0)
    error = np.degrees(Rotation.from_matrix(found.rotation @ turn).magnitude())
    assert error < bound_deg
    np.testing.assert_allclose(
        found.translation, view.point_to_camera(model.middle) * [1, 1, 0] - [0, 0, 10], atol=2e-3
    )
    assert np.std(found.outline_residual) < 0.5 and abs(found.outline_offset) < 0.3
    assert 0 < np.linalg.norm(found.rotation_sigma_deg) < bound_deg


def test_pose_of_a_box_from_its_silhouette(tmp_path, blob):
    """Few long edges, of which only those between light and dark faces make the outline."""
    import trimesh

    view = blob[0]
    trimesh.creation.box((0.8, 1.1, 0.5)).export(tmp_path / "box.ply")
    mesh, model = read_model(tmp_path / "box.ply", 1.0)
    turn = Rotation.from_euler("xyz", [25, 30, 10], degrees=True).as_matrix()
    hull = Delaunay(view.project(mesh.vertices @ turn.T + [0.1, 0.05, -10]))
    mask = hull.find_simplex(pixel_centers(np.ones((96, 96), bool))).reshape(96, 96) >= 0
    start = Rotation.from_euler("xyz", [4, -3, 5], degrees=True).as_matrix()
    found = find_pose(view, turned(model, start @ turn), Evidence(mask=mask), 10.0)
    assert np.degrees(Rotation.from_matrix(found.rotation @ start).magnitude()) < 1.2
    np.testing.assert_allclose(found.translation, [0.1, 0.05, -10], atol=3e-3)
    assert abs(found.outline_offset) < 0.2


def test_pose_from_points_with_any_start(blob, points):
    view, _, _, _, model = blob
    pixel, point = points
    found = find_pose(view, model, Evidence(pixel, point), 10.0)
    error = np.degrees(Rotation.from_matrix(found.rotation).as_rotvec())
    assert (np.abs(error) < 4 * found.rotation_sigma_deg).all()
    assert (found.rotation_sigma_deg < 0.6).all() and found.translation_sigma[2] == 0
    assert found.point_residual.max() < 1.5


def test_pose_command_renders_the_truth(blob, points, tmp_path, capsys):
    _, mask, truth, mesh, _ = blob
    np.save(tmp_path / "mask.npy", mask)
    moved = mesh.copy().apply_scale(100).apply_translation([300, 0, -50])  # a model in its own unit and place
    moved.export(tmp_path / "model.stl")
    pixel, point = points[0], 100 * points[1] + [300, 0, -50]
    rows = [",".join(f"{v:.6f}" for v in (*p, *x)) for p, x in zip(pixel, point)]
    (tmp_path / "points.csv").write_text("x_pixel,y_pixel,X,Y,Z\n" + "\n".join(rows) + "\n")
    arguments = [
        "pose",
        str(SCENES / "blob.xml"),
        str(tmp_path / "model.stl"),
        "-D",
        "size=96",
        "--unit",
        "0.01",
    ]
    arguments += ["--points", str(tmp_path / "points.csv"), "--spp", "4"]
    out = tmp_path / "out"
    assert calibrate.main([*arguments, "--mask", str(tmp_path / "mask.npy"), "--out", str(out)]) == 0
    made = np.load(out / "truth.npz")
    both = made["mask"] & truth.mask
    assert both.sum() > 0.97 * truth.mask.sum()
    assert np.median(angular_error_deg(made["normal"][both], truth.normal[both])) < 0.7
    text = (SCENES / "blob.xml").read_text()
    start, end = text.index("<shape"), text.index("</shape>") + len("</shape>")
    text = text[:start] + '<include filename="out/pose.xml"/>' + text[end:]
    text = text.replace('filename="camera', f'filename="{SCENES}/camera').replace(
        '="ring24', f'="{SCENES}/ring24'
    )
    text = text.replace('<include filename="bases_$bases.xml"/>', '<bsdf type="diffuse" id="surface"/>')
    (tmp_path / "scene.xml").write_text(text)
    again = surface_maps(load_scene(tmp_path / "scene.xml", {"size": "96"}), 4)
    np.testing.assert_allclose(again.normal[both], made["normal"][both], atol=1e-4)
    (tmp_path / "points.csv").write_text("\n".join(["1,2,0,0,0", "2,3,1,1,1", "3,4,2,2,2", "4,5,3,3,3"]))
    for extra, says in (([], "lie on one line"), (["--unit", "0"], "--unit must be finite")):
        assert calibrate.main([*arguments, *extra, "--out", str(tmp_path / "no")]) == 2
        assert says in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_meshes_that_can_not_be_used_are_refused(tmp_path, blob):
    (tmp_path / "bad.obj").write_text("nothing\n")
    for name, says in (("none.ply", "no such file"), ("bad.obj", "not a mesh that trimesh reads")):
        with pytest.raises(InputError, match=says):
            read_model(tmp_path / name, 1.0)
    view, mask, _, _, model = blob
    for evidence, says in (
        (Evidence(), "nothing tells the pose"),
        (Evidence(mask=mask & False), "mask is empty"),
    ):
        with pytest.raises(InputError, match=says):
            find_pose(view, model, evidence, 10.0)
    with pytest.raises(InputError, match="border of the image"):
        find_pose(view, model, Evidence(mask=mask | True), 10.0)


@pytest.mark.parametrize("name", ["nefertiti-lowres.obj", "skull_low_resolution.obj"])
def test_pose_of_a_downloaded_mesh(shared_data, blob, name):
    """A mesh of another program, of any size, from twelve exact points."""
    view = blob[0]
    mesh, raw = read_model(shared_data / "meshes" / name, 1.0)
    unit = 0.9 / raw.size
    mesh, model = read_model(shared_data / "meshes" / name, unit)
    turn = Rotation.from_euler("xyz", [40, 100, -30], degrees=True).as_matrix()
    rng = np.random.default_rng(2)
    point = mesh.vertices[rng.choice(len(mesh.vertices), 12)]
    placed = unit * (point - model.middle) @ turn.T + [0.05, -0.03, -10]
    found = find_pose(view, model, Evidence(view.project(placed), point), 10.0)
    np.testing.assert_allclose(found.rotation, turn, atol=1e-5)
    np.testing.assert_allclose(found.translation[:2], [0.05, -0.03], atol=1e-5)


def test_flat_scene_is_the_same_scene(tmp_path):
    """Includes, defaults and file names replaced; LEDs complete in themselves."""
    root = flatten(SCENES / "near_ring.xml", {"size": "16"})
    assert not root.findall("include") and "$" not in ET.tostring(root, encoding="unicode")
    (tmp_path / "flat.xml").write_text(ET.tostring(root, encoding="unicode"))
    flat, ring = load_scene(tmp_path / "flat.xml"), load_scene(SCENES / "near_ring.xml", {"size": "16"})
    np.testing.assert_allclose(surface_maps(flat, 1).reflectance, surface_maps(ring, 1).reflectance)
    found = find_leds(root)
    moved = [place_led(scale_led(led, 1.5), None, np.array([j, 1.0, 4.0])) for j, led in enumerate(found)]
    (tmp_path / "rig.xml").write_text(include_text("moved", moved, {"constant_light": 0.125}))
    (tmp_path / "scene.xml").write_text(
        scene(light="").replace("<default", '<include filename="rig.xml"/><default', 1)
    )
    loaded = load_scene(tmp_path / "scene.xml")
    np.testing.assert_allclose(loaded.leds.power, 1.5 * ring.leds.power, rtol=1e-5)
    np.testing.assert_array_equal(loaded.leds.band, ring.leds.band)
    assert loaded.constant_light == 0.125


@pytest.mark.parametrize(
    "spectrum, factor_on",
    [
        ('<spectrum name="irradiance" value="430:0, 450:0.5, 470:0"/>', "430:0, 450:1, 470:0"),
        ('<spectrum name="irradiance" value="0.25"/>', "0.5"),
        ('<rgb name="irradiance" value="0.5 1e-1 0"/>', "1 0.2 0"),
    ],
)
def test_spectra_are_scaled_as_text(spectrum, factor_on):
    led = ET.fromstring(f'<emitter type="directional" id="led_0">{spectrum}</emitter>')
    assert scale_led(led, 2.0)[0].get("value") == factor_on
    assert scale_led(led, 1.0)[0].get("value") != factor_on


def test_leds_that_can_not_be_moved_or_scaled_are_refused(tmp_path):
    shape = ET.fromstring('<shape type="rectangle" id="led_0"><emitter type="area"/></shape>')
    with pytest.raises(InputError, match="a shape that shines"):
        place_led(shape, np.array([0, 0, 1.0]), None)
    with pytest.raises(InputError, match="no spectrum to scale"):
        scale_led(shape, 2.0)
    file = '<emitter type="point" id="led_0"><spectrum name="intensity" type="d65"/></emitter>'
    with pytest.raises(InputError, match="type d65 can't be scaled"):
        scale_led(ET.fromstring(file), 2.0)
    (tmp_path / "bad.xml").write_text("<scene>")
    with pytest.raises(InputError, match="not a readable scene file"):
        flatten(tmp_path / "bad.xml", {})
