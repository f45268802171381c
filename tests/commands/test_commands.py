"""The commands as their users meet them: what they leave behind, and how they stop."""

import gc
import html
import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import png
import pytest

from evsdr.commands import calibrate, fit, simulate
from evsdr.files import results
from evsdr.fitting import decoder
from evsdr.page.codec import Layer, unpack
from evsdr.page.contents import KNOWN, SOLVED
from evsdr.solve import problem
from tests.conftest import REPOSITORY
from tests.support.command_line import change, contents, read
from tests.support.command_line import replace as rewrite
from tests.support.small_scene import DIFFUSE, HEIGHT, WIDTH, scene

# ---------------------------------------------------------------------- stopped


def test_stopped_while_solving(commands, monkeypatch):
    monkeypatch.setattr(decoder, "solve", interrupt)
    before = contents(commands.folder)
    assert commands.fit() == (130, "", "stopped; nothing was written.\n")
    assert contents(commands.folder) == before


def test_stopped_while_writing(commands, monkeypatch):
    monkeypatch.setattr(results, "write_png", interrupt)
    (commands.folder / "out" / "normal.exr").touch()
    before = contents(commands.folder)
    assert commands.fit()[0] == commands.fit(out="new/deep")[0] == 130
    assert contents(commands.folder) == before


def interrupt(*_):
    raise KeyboardInterrupt


def test_no_garbage_is_collected_while_the_solver_records(commands, monkeypatch):
    """An old scene freed there makes Dr.Jit abort the process."""

    class Ring(problem.LambertianRing):
        def __call__(self, *argv):
            collects.add(gc.isenabled())
            return super().__call__(*argv)

    collects = set()
    monkeypatch.setattr(problem, "LambertianRing", Ring)
    assert commands.fit()[0] == 0
    assert collects == {False} and gc.isenabled()


# ---------------------------------------------------------------------- what a fit leaves behind


def test_results(commands):
    maps, summary = commands.results("--truth", commands.folder / "truth.npz")
    names = "maps.npz normal.exr reflectance.exr normal.png reflectance.png depth.exr mesh.ply report.html summary.json"
    assert {path.name for path in (commands.folder / "out").iterdir()} == set(names.split())
    assert maps["normal"].shape == (HEIGHT, WIDTH, 3)
    np.testing.assert_allclose(maps["band_wavelength_nm"], [450, 620], atol=0.01)
    assert set(summary) >= {"model", "numbers", "seconds", "warnings", "residual"}
    assert summary["warnings"] == []
    assert summary["mae_deg"] < 5 and summary["median_deg"] < 4
    assert summary["sam_deg"] < 3 and summary["rmse"] < 0.15
    numbers = summary["numbers"]
    assert (
        numbers["pixels_known"] == np.count_nonzero(maps["mask"]) <= numbers["pixels_solved"] < WIDTH * HEIGHT
    )
    assert 0 < numbers["pairs"] < numbers["events"] <= len(read(commands.folder, "CD/events"))
    assert summary["seconds"].keys() >= {"read events", "load scene", "trace light", "pair events", "solve"}
    assert min(summary["seconds"].values()) >= 0
    assert not maps["mask"][0, 0] and maps["mask"][HEIGHT // 2, WIDTH // 2]
    np.testing.assert_array_equal(maps["normal"][0, 0], [0, 0, 1])
    assert (
        maps["normal"][HEIGHT // 2, -5, 0] > 0.3 and maps["normal"][2, WIDTH // 2, 1] > 0.3
    )  # x right, y up


def test_report_holds_what_the_summary_says(commands):
    maps, summary = commands.results("--truth", commands.folder / "truth.npz")
    page = (commands.folder / "out" / "report.html").read_text(encoding="utf-8")
    assert f"<title>{commands.folder.name} / events" in page
    assert summary["command"].startswith("python -m evsdr.fit ") and "--preset fast" in summary["command"]
    assert summary["command"] in html.unescape(page)
    for why in summary["model"].values():
        assert why in html.unescape(page)
    held = json.loads(re.search(r'id="evsdr-report">(.*?)</script>', page)[1], parse_constant=pytest.fail)
    assert set(held["layers"]) >= {"normal", "reflectance", "depth", "light", "change", "angle_deg", "rmse"}
    state = unpack(Layer(**held["layers"]["state"])).astype(int).reshape(HEIGHT, WIDTH)
    np.testing.assert_array_equal(state & KNOWN > 0, maps["mask"])
    normal = unpack(Layer(**held["layers"]["normal"]))
    np.testing.assert_allclose(normal, maps["normal"][state & SOLVED > 0], atol=2e-5)
    assert "signals" in summary["seconds"]


def test_without_report(commands):
    assert "report.html" in commands.fit()[1]
    assert (commands.folder / "out" / "report.html").exists()
    status, out, _ = commands.fit("--no-report")
    assert status == 0 and "report.html" not in out
    assert not (commands.folder / "out" / "report.html").exists()  # that of the earlier fit went
    assert (commands.folder / "out" / "summary.json").exists()


def test_default_folder_is_named_after_the_events(commands):
    status, out, err = commands.fit(out=None)
    assert (status, err) == (0, "")
    assert (commands.folder / "events" / "maps.npz").is_file()
    assert str(commands.folder / "events") in out.replace("\n", "")


def test_other_files_in_the_folder_stay(commands):
    (commands.folder / "out" / "note.txt").write_text("mine")
    commands.results()
    assert (commands.folder / "out" / "note.txt").read_text() == "mine"


def test_names_with_brackets_and_spaces(commands):
    folder = commands.folder / "a [b] é[" / "c]"  # [/c] would close a style of rich
    folder.mkdir(parents=True)
    shutil.copy(commands.folder / "scene.xml", folder)
    shutil.copy(commands.folder / "events.h5", folder)
    status, out, err = commands.run(fit.main, folder / "scene.xml", folder / "events.h5", "--preset", "fast")
    assert (status, err) == (0, "")
    assert f"all else in {folder / 'events'}" in out
    assert (folder / "events" / "summary.json").is_file()


def test_same_seed_gives_the_same_maps(commands):
    first, _ = commands.results("--seed", 3)
    second, _ = commands.results("--seed", 3, out="second")
    for name in first:
        np.testing.assert_array_equal(first[name], second[name])


def test_same_seed_gives_the_same_events(commands):
    for out, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert commands.simulate("--rounds", 2, "--seed", seed, out=out, ideal=())[0] == 0
    first, second, third = (read(commands.folder / out, "CD/events") for out in "abc")
    np.testing.assert_array_equal(first, second)
    assert len(third) != len(first) or (third != first).any()
    same, other = (read(commands.folder / out, "sensor/contrast_threshold_on") for out in "bc")
    assert (same != other).all()


def test_without_constant_light_the_scale_is_unknown(commands):
    assert commands.simulate("-D", "constant_light=0")[0] == 0
    maps, summary = commands.results("-D", "constant_light=0")
    message = summary["warnings"][0]
    assert "scene.xml: constant_light is 0" in message and "scale" in message
    assert summary["model"]["scale"].startswith("unknown")
    known = maps["mask"]
    assert np.count_nonzero(known) > 30
    np.testing.assert_allclose(maps["reflectance"][known].max(axis=-1), 1, rtol=1e-6)


def test_missing_sensor_attributes_are_warned_of_once(commands):
    change(commands.folder, "sensor", contrast_threshold_off=None, refractory_us=None)
    _, summary = commands.results()
    (message,) = summary["warnings"]
    assert re.search(r"events\.h5: sensor lacks contrast_threshold_off .*, refractory_us", message)


def test_geometry_as_start(commands):
    _, summary = commands.results("--init", "geometry", "--truth", commands.folder / "truth.npz")
    assert summary["mae_deg"] < 5


@pytest.mark.parametrize("shadows", ["auto", "off", "scene", "downweight"])
def test_shadows(commands, shadows):
    _, summary = commands.results("--shadows", shadows, "--truth", commands.folder / "truth.npz")
    assert summary["mae_deg"] < 6
    assert (f"--shadows {shadows}" in summary["model"]["cast shadows"]) == (shadows != "auto")


def test_mask_of_some_pixels(commands):
    wanted = np.zeros((HEIGHT, WIDTH), np.uint8)
    wanted[4:8, 5:11] = 255
    with open(commands.folder / "mask.png", "wb") as file:
        png.Writer(WIDTH, HEIGHT, greyscale=True).write(file, wanted.tolist())
    maps, summary = commands.results("--mask", commands.folder / "mask.png")
    np.testing.assert_array_equal(maps["mask"], wanted > 0)
    assert summary["numbers"]["pixels_solved"] == 24


def test_mask_of_one_pixel(commands):
    wanted = np.zeros((HEIGHT, WIDTH), bool)
    wanted[5, 6] = True
    np.save(commands.folder / "mask.npy", wanted)
    alone, _ = commands.results("--mask", commands.folder / "mask.npy", "--shadows", "scene")
    together, _ = commands.results("--shadows", "scene")
    np.testing.assert_array_equal(alone["mask"], wanted)
    angle = np.degrees(np.arccos(np.clip(alone["normal"][5, 6] @ together["normal"][5, 6], -1, 1)))
    assert angle < 5


def test_rectangle_stands_for_an_unknown_shape(commands):
    """Events of a sphere, solved on a plane that fills the film; of that only what fires, and what it encloses."""
    large = '<transform name="to_world"><scale value="5"/></transform>'
    plane = f'<shape type="rectangle" id="object">{large}{DIFFUSE}</shape>'
    (commands.folder / "plane.xml").write_text(scene(shape=plane))
    maps, summary = commands.results("--truth", commands.folder / "truth.npz", scene="plane.xml")
    assert "geometry" not in summary["model"]["cast shadows"]
    assert summary["mae_deg"] < 6
    dark = summary["effects"]["outline"]["found"]["pixels"]
    assert 0 < dark == WIDTH * HEIGHT - summary["numbers"]["pixels_solved"]
    assert not maps["mask"][:, 0].any()  # dark: no events there


def test_a_set_up_that_is_told_wrong(commands):
    """Polarities are swapped: the results are written, the status is 3, and --repair gives those of the right file."""
    truth = ("--truth", commands.folder / "truth.npz")
    _, right = commands.results(*truth, out="right")
    events = read(commands.folder, "CD/events")
    events["p"] = 1 - events["p"]
    rewrite(commands.folder, "CD/events", events)
    _, told = commands.results(*truth, status=3)
    sentence = told["verdict"].removeprefix("contradicted: ")
    assert sentence in told["warnings"] and "events.h5: polarities are flipped: with that, " in sentence
    assert sentence.endswith("; write 1 - p for p in CD/events, or use --repair.")
    assert told["effects"]["set-up"]["found"]["error"] == "polarities are flipped"
    assert told["mae_deg"] > 5 * right["mae_deg"]
    _, mended = commands.results(*truth, "--repair")
    assert mended["verdict"].startswith("doubtful: ") and "the fit took that for true" in mended["verdict"]
    assert mended["effects"]["set-up"]["modelled"]
    assert mended["mae_deg"] == pytest.approx(right["mae_deg"], rel=1e-3)


def test_constant_light_that_is_not_told(commands):
    truth = ("--truth", commands.folder / "truth.npz", "-D", "constant_light=0")
    _, told = commands.results(*truth, status=3)
    assert "there is constant light though constant_light is 0" in told["verdict"]
    maps, mended = commands.results(*truth, "--repair")
    assert mended["mae_deg"] < 5 < told["mae_deg"]
    np.testing.assert_allclose(maps["reflectance"][maps["mask"]].max(axis=-1), 1, rtol=1e-6)


# ---------------------------------------------------------------------- as processes


def process(*words, **variables):
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=REPOSITORY,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("name", ["fit", "simulate"])
def test_help_does_not_load_mitsuba(name):
    at_exit = "atexit.register(lambda: print(sorted(sys.modules)))"
    code = f"import atexit, sys; from evsdr.commands.{name} import main; {at_exit}; main()"
    run = process("-c", code, "--help", COLUMNS="100")
    assert run.returncode == 0 and run.stderr == ""
    assert f"usage: python -m evsdr.{name} " in run.stdout
    assert not re.search("'(mitsuba|drjit|colour)'", run.stdout)


def test_process_without_a_scene(tmp_path):
    run = process("-m", "evsdr.fit", tmp_path / "scene.xml", tmp_path / "events.h5")
    assert (run.returncode, run.stdout) == (2, "")
    assert re.fullmatch(r"error: .*events\.h5: .*\.\n", run.stderr)
    assert list(tmp_path.iterdir()) == []


def test_process_with_results(place):
    run = process("-m", "evsdr.fit", place / "scene.xml", place / "events.h5", "--preset", "fast")
    assert (run.returncode, run.stderr) == (0, "")
    assert "solve [s]" in run.stdout and "cast shadows: " in run.stdout
    assert (place / "events" / "maps.npz").is_file()


def test_a_simulated_flicker_tells_thresholds(recorded, tmp_path):
    """One value is told for all pixels; the spread comes from the events."""
    words = [str(recorded / "scene.xml"), "--out", str(tmp_path), "--flicker", "--thresholds", "nominal"]
    assert simulate.main(words) == 0
    out = tmp_path / "thresholds"
    words = ["thresholds", str(tmp_path / "events.h5"), "--waveform", "ring", "--out", str(out)]
    assert calibrate.main(words) == 0
    told = json.loads((out / "calibration.json").read_text())["contrast_threshold_on"]
    assert told["median"] == pytest.approx(0.2525, rel=0.1) and told["pixels_known"] > 10
