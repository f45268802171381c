"""A scene that nobody has written by hand."""

import pytest
import trimesh

from evsdr.commands.new_scene import main
from evsdr.light.scene import load_scene

TABLE = "azimuth_deg,polar_deg,wavelength_nm\n0,45,450\n120,45,550\n240,45,450\n"


@pytest.fixture
def run(tmp_path, capsys):
    (tmp_path / "leds.csv").write_text(TABLE)
    trimesh.creation.icosphere().export(tmp_path / "m & m.ply")

    def run(*options, table="leds.csv"):
        status = main([str(tmp_path / table), "--size", "16", "12", *options])
        return status, *capsys.readouterr()

    return run


def test_written_told_and_replaced(run, tmp_path):
    status, out, err = run("--field-width", "3", "--unit", "mm", "--constant-light", "0.1")
    assert (status, err) == (0, "")
    assert "3, far" in out and "450, 550 nm" in out and "0.1875 mm" in out and "of unknown shape" in out
    ring = load_scene(tmp_path / "leds.xml")
    assert ring.leds.n_led == 3 and ring.constant_light == pytest.approx(0.1)
    options = ("--focal-mm", "25", "--distance", "300", "--mesh", str(tmp_path / "m & m.ply"))
    assert run(*options)[0] == 0
    assert load_scene(tmp_path / "leds.xml").shape_is_known


@pytest.mark.parametrize(
    "options, sentence",
    [
        ((), "tell the camera by"),
        (("--field-width", "3", "--sphere", "0"), "--sphere is 0"),
        (("--field-width", "3", "--sphere", "1", "--mesh", "a.ply"), "--sphere and --mesh tell the same"),
        (("--field-width", "3", "--mesh", "a.stl"), "a.stl: this is no PLY or OBJ file"),
        (("--field-width", "3", "--constant-light", "-1"), "--constant-light is -1"),
        (("--field-width", "3", "--out", "leds.csv"), "this is the table itself"),
        (("--field-width", "3", "--out", "mine.xml"), "mine.xml: this file is not of this command"),
        (("--field-width", "3", "--mesh", "broken.ply"), "out.xml: "),
    ],
)
def test_one_sentence_and_nothing_written(run, tmp_path, monkeypatch, options, sentence):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.xml").write_text("<scene/>")
    (tmp_path / "broken.ply").write_text("ply")
    before = sorted(tmp_path.iterdir())
    status, out, err = run(*(options if "--out" in options else (*options, "--out", "out.xml")))
    assert (status, out) == (2, "")
    assert sentence in err and err.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before
