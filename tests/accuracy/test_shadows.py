"""Light and shape that depend on each other, and geometry that does not fit, by the commands."""

import json

import numpy as np
import pytest
import trimesh

from evsdr.commands import fit, simulate
from evsdr.effects import surface
from evsdr.metrics import angular_error_deg
from evsdr.shape.traced import traced_mesh
from tests.conftest import REPOSITORY
from tests.support.small_scene import DIFFUSE, SPHERE, camera, leds, scene

SIZE = 32
SENSOR = camera(width=SIZE, height=SIZE)
PLANE = f"""<shape type="rectangle" id="object"><transform name="to_world"><scale value="3"/></transform>
    {DIFFUSE}</shape>"""
LIGHT = leds(12)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Give a callable that records a scene once."""
    folders = {}

    def record(name, text):
        if name not in folders:
            folder = folders[name] = tmp_path_factory.mktemp(name)
            (folder / "scene.xml").write_text(text)
            argv = [str(folder / "scene.xml"), "--out", str(folder), "--ideal", "--rounds", "4"]
            assert simulate.main(argv) == 0
        return folders[name]

    return record


def run(folder, out, text, *argv, truth=True, status=(0,)):
    """Fit a recording, whose pixels share nothing that is unknown, with a scene; gives summary and folder."""
    (out / "fitted.xml").write_text(text)
    given = [
        str(out / "fitted.xml"),
        str(folder / "events.h5"),
        "--out",
        str(out / "fit"),
        "--preset",
        "fast",
        "--shared",
        "none",
    ]
    given += ["--truth", str(folder / "truth.npz")] if truth else []
    assert fit.main([*given, *argv]) in status
    return json.loads((out / "fit" / "summary.json").read_text()), out / "fit"


def relief(extra=""):
    return f"""<shape type="ply" id="object"><string name="filename" value="{REPOSITORY}/scenes/relief.ply"/>
        <transform name="to_world"><scale value="1.6"/></transform>{extra}{DIFFUSE}</shape>"""


def with_depth(depth):
    return f'<integrator type="ring"><float name="constant_light" value="0.05"/><integer name="max_depth" value="{depth}"/></integrator>'


# ---------------------------------------------------------------------- unknown shape


def test_auto_finds_the_shadows_of_an_unknown_relief(recorded, tmp_path):
    """`auto` hears them in the events, and what it then gives is much better than `off`."""
    sensor = camera(width=44, height=44)
    folder = recorded("relief", scene(shape=relief(), light=LIGHT, sensor=sensor))
    unknown = scene(shape=PLANE, light=LIGHT, sensor=sensor)
    off, _ = run(folder, tmp_path, unknown, "--shadows", "off")
    auto, out = run(folder, tmp_path, unknown)
    assert auto["model"]["cast shadows"].startswith("found: ")
    assert auto["mae_deg"] < 0.7 * off["mae_deg"]
    assert off["model"]["cast shadows"] == "not modelled: asked for by --shadows off"


def test_auto_leaves_an_unknown_sphere_alone(recorded, tmp_path):
    folder = recorded("sphere", scene(light=LIGHT, sensor=SENSOR))
    np.save(tmp_path / "mask.npy", np.load(folder / "truth.npz")["mask"])
    text = scene(shape=PLANE, light=LIGHT, sensor=SENSOR)
    summary, _ = run(folder, tmp_path, text, "--mask", str(tmp_path / "mask.npy"))
    assert summary["model"]["cast shadows"].startswith("not modelled: ")
    assert "rounds of light and shape" not in summary["model"]
    assert summary["mae_deg"] < 3


def test_events_overrule_shadows_of_a_wrong_surface(recorded, tmp_path, monkeypatch):
    """Spikes that the recorded sphere has not: they cast shadows, but the events know better."""
    folder = recorded("sphere", scene(light=LIGHT, sensor=SENSOR))
    np.save(tmp_path / "mask.npy", np.load(folder / "truth.npz")["mask"])

    def with_spikes(*given):
        position, face = traced_mesh(*given)
        spike = np.random.default_rng(0).random(len(position)) < 0.01
        return position + spike[:, None] * [0, 0, 0.3], face

    monkeypatch.setattr(surface, "traced_mesh", with_spikes)
    text = scene(shape=PLANE, light=LIGHT, sensor=SENSOR)
    summary, _ = run(folder, tmp_path, text, "--mask", str(tmp_path / "mask.npy"))
    assert summary["model"]["cast shadows"].startswith("not modelled: ")
    assert summary["mae_deg"] < 3


def test_a_forgotten_pole_is_found(recorded, tmp_path):
    """The scene file has the sphere, but not what stood beside it."""
    pole = f"""<shape type="cylinder" id="pole"><point name="p0" x="0.45" y="0.3" z="0.5"/>
        <point name="p1" x="0.45" y="0.3" z="1.6"/><float name="radius" value="0.06"/>{DIFFUSE}</shape>"""
    ball = f'<shape type="sphere" id="object">{DIFFUSE}</shape>'
    folder = recorded("poled", scene(shape=ball + pole, light=LIGHT, sensor=SENSOR))
    np.save(tmp_path / "mask.npy", np.load(folder / "truth.npz")["mask"])
    text, mask = scene(shape=ball, light=LIGHT, sensor=SENSOR), ("--mask", str(tmp_path / "mask.npy"))
    off, _ = run(folder, tmp_path, text, "--shadows", "off", *mask)
    fast, _ = run(folder, tmp_path, text, *mask)
    assert fast["model"]["cast shadows"].startswith(
        "not modelled: no (pixel, LED) pair"
    )  # it believes the shape
    auto, _ = run(folder, tmp_path, text, *mask, "--preset", "balanced")
    assert auto["model"]["cast shadows"].startswith("found: ")
    assert auto["mae_deg"] < 0.75 * off["mae_deg"]


def test_surface_is_written(recorded, tmp_path):
    """Depth and a mesh with normals and colours, in the world."""
    import OpenEXR

    folder = recorded("sphere", scene(light=LIGHT, sensor=SENSOR))
    _, out = run(folder, tmp_path, scene(light=LIGHT, sensor=SENSOR))
    with np.load(out / "maps.npz") as maps:
        mask, normal = maps["mask"], maps["normal"]
    depth = OpenEXR.File(str(out / "depth.exr")).channels()["Z"].pixels
    assert (depth[~mask] == 0).all()
    middle = depth[SIZE // 2 - 1 : SIZE // 2 + 1, SIZE // 2 - 1 : SIZE // 2 + 1].mean()
    assert middle == pytest.approx(3, abs=0.08)  # the camera's plane is 4 from the sphere's centre
    mesh = trimesh.load(out / "mesh.ply", process=False)
    assert len(mesh.vertices) == mask.sum()
    inner = normal[mask][:, 2] > 0.6
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1)[inner], 1, atol=0.12)
    np.testing.assert_allclose(mesh.vertex_normals[inner], normal[mask][inner], atol=0.02)
    assert mesh.visual.vertex_colors.shape == (mask.sum(), 4)


# ---------------------------------------------------------------------- indirect light


def test_indirect_light_is_modelled_where_it_counts(tmp_path):
    """In a groove, rendered with many rays as their noise is not real, light goes to and fro."""
    corner = [(x, y, 0.7 * abs(x)) for y in (-1.2, 1.2) for x in (-1.2, 0, 1.2)]
    groove = trimesh.Trimesh(corner, [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)], process=False)
    groove.export(tmp_path / "groove.ply")
    shape = f"""<shape type="ply" id="object"><string name="filename" value="{tmp_path}/groove.ply"/>
        <boolean name="face_normals" value="true"/>{DIFFUSE}</shape>"""
    text = scene(integrator=with_depth(3), shape=shape, light=LIGHT, sensor=camera(width=24, height=24))
    (tmp_path / "scene.xml").write_text(text)
    argv = [str(tmp_path / "scene.xml"), "--out", str(tmp_path), "--ideal", "--rounds", "4", "--spp", "256"]
    assert simulate.main(argv) == 0
    # What comes by way of the other side may pass for a constant light that is told wrong
    direct, _ = run(tmp_path, tmp_path, text, "--light-paths", "direct", status=(0, 3))
    auto, _ = run(tmp_path, tmp_path, text)
    assert auto["model"]["light paths"].startswith("direct and indirect light: ")
    assert direct["model"]["light paths"].startswith("direct light only: asked for")
    assert auto["mae_deg"] < 0.4 * direct["mae_deg"]
    assert auto["rmse"] < 0.4 * direct["rmse"]


def test_indirect_light_is_left_out_where_there_is_none(recorded, tmp_path):
    text = scene(integrator=with_depth(3), light=LIGHT, sensor=SENSOR)
    summary, _ = run(recorded("sphere", scene(light=LIGHT, sensor=SENSOR)), tmp_path, text)
    note = summary["model"]["light paths"]
    assert (
        note.startswith("direct light only: indirect light, left out, that turns")
        and "less than 0.05" in note
    )


# ---------------------------------------------------------------------- near LEDs


def test_near_fitted_as_far_is_worse(recorded, tmp_path):
    text = scene(light=leds(12, distance=3.5), sensor=SENSOR)
    folder = recorded("near", text)
    near, _ = run(folder, tmp_path, text)
    far, _ = run(folder, tmp_path, text, "--leds", "far")
    assert near["model"]["LEDs"].startswith("12 in 2 bands, near") and "more than" in near["model"]["LEDs"]
    assert far["mae_deg"] > 2 * near["mae_deg"]


def test_near_light_on_the_depth_that_is_found(recorded, tmp_path):
    """The shape unknown, the LEDs near: the estimated depth beats the placeholder's plane."""
    folder = recorded("near", scene(light=leds(12, distance=3.5), sensor=SENSOR))
    np.save(tmp_path / "mask.npy", np.load(folder / "truth.npz")["mask"])
    lifted = PLANE.replace('<scale value="3"/>', '<scale value="3"/><translate z="0.6"/>')
    text = scene(shape=lifted, light=leds(12, distance=3.5), sensor=SENSOR)
    mask = ["--mask", str(tmp_path / "mask.npy")]
    off, _ = run(folder, tmp_path, text, *mask, "--leds", "far", "--shadows", "off")
    found, _ = run(folder, tmp_path, text, *mask)
    assert "on the estimated depth" in found["model"]["LEDs"]
    assert found["mae_deg"] < 0.6 * off["mae_deg"]


# ---------------------------------------------------------------------- geometry that does not fit


def warned(summary, words):
    assert any(words in message for message in summary["warnings"]), summary["warnings"]


def test_led_that_lights_nothing(recorded, tmp_path):
    """One LED inside the sphere, by the scene file."""
    light, sensor = leds(12, distance=3.5), camera(width=16, height=16)
    folder = recorded("small", scene(light=light, sensor=sensor))
    first = light.splitlines()[0]
    inside = first.replace('x="2.474', 'x="0.2474').replace('z="2.474', 'z="0.2474')
    assert inside != first
    summary, _ = run(folder, tmp_path, scene(light=light.replace(first, inside), sensor=sensor))
    warned(summary, "LED 0 lights no pixel of the object")


def test_pieces_of_an_unknown_shape(recorded, tmp_path):
    folder = recorded("sphere", scene(light=LIGHT, sensor=SENSOR))
    mask = np.load(folder / "truth.npz")["mask"]
    mask[:, SIZE // 2 - 2 : SIZE // 2 + 2] = False
    np.save(tmp_path / "mask.npy", mask)
    text = scene(shape=PLANE, light=LIGHT, sensor=SENSOR)
    argv = "--mask", str(tmp_path / "mask.npy"), "--shadows", "estimate"
    summary, out = run(folder, tmp_path, text, *argv)
    warned(summary, "seen in 2 pieces")
    truth = np.load(folder / "truth.npz")["normal"]
    with np.load(out / "maps.npz") as maps:
        assert angular_error_deg(maps["normal"], truth)[maps["mask"]].mean() < 1
        assert maps["mask"].sum() > 0.95 * mask.sum()


def test_geometry_of_another_object(recorded, tmp_path):
    """The relief's geometry for a recording of the sphere: light traced on it, normals contradict."""
    folder = recorded("sphere", scene(light=LIGHT, sensor=SENSOR))
    text = scene(shape=relief(), light=LIGHT, sensor=SENSOR)
    summary, _ = run(folder, tmp_path, text, "--shadows", "scene")
    warned(summary, "off those of the object's geometry")


def test_holes_and_flipped_faces(recorded, tmp_path):
    """A mesh of the sphere with a third of its faces turned over and holes: the pixels that it has come out well."""
    folder = recorded("sphere", scene(light=LIGHT, sensor=SENSOR))
    ball = trimesh.creation.icosphere(subdivisions=4)
    face = np.asarray(ball.faces)
    rng = np.random.default_rng(0)
    turned = rng.random(len(face)) < 0.3
    face[turned] = face[turned][:, ::-1]
    kept = rng.random(len(face)) > 0.02
    trimesh.Trimesh(ball.vertices, face[kept], process=False).export(tmp_path / "holes.ply")
    shape = f"""<shape type="ply" id="object"><string name="filename" value="{tmp_path}/holes.ply"/>
        <boolean name="face_normals" value="true"/>{DIFFUSE}</shape>"""
    summary, _ = run(folder, tmp_path, scene(shape=shape, light=LIGHT, sensor=SENSOR), "--shadows", "scene")
    assert summary["mae_deg"] < 4
    assert SPHERE  # the truth is that of the whole sphere
