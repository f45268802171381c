"""The commands as their users meet them: what bad input says, and what good input leaves behind."""

import gc
import json
import os
import re
import shutil
import subprocess
import sys
from functools import partial

import h5py
import numpy as np
import png
import pytest
from conftest import REPOSITORY
from small_scene import DIFFUSE, HEIGHT, RING, SPHERE, WIDTH, camera, leds, scene

from evsdr import decode, fit, results, simulate
from evsdr.event_pixel import EventPixel, simulate_events
from evsdr.recording import write_recording
from evsdr.records import Recording, Schedule, Sensor

N_LED, N_BAND = 8, 2


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Give a folder with scene.xml, and events.h5 and truth.npz simulated from it."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "scene.xml").write_text(scene())
    assert simulate.main([str(folder / "scene.xml"), "--out", str(folder), "--ideal", "--rounds", "4"]) == 0
    return folder


@pytest.fixture
def place(recorded, tmp_path):
    """Give a copy of that folder, to spoil, with the results of an earlier run in `out`."""
    for name in ("scene.xml", "events.h5", "truth.npz"):
        shutil.copy(recorded / name, tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "maps.npz").write_text("an earlier run")
    return tmp_path


class Commands:
    """Runs commands in a folder with its scene.xml and events.h5, and reads what they print."""

    def __init__(self, folder, capsys):
        self.folder, self.capsys = folder, capsys

    def run(self, main, *argv):
        """Give exit status, standard output and standard error."""
        self.capsys.readouterr()
        status = main([str(word) for word in argv])
        return status, *self.capsys.readouterr()

    def refused(self, main, *argv):
        """Run on bad input, check that nothing but one sentence comes of it, and give the sentence."""
        before = contents(self.folder)
        status, out, err = self.run(main, *argv)
        *warned, sentence = err.splitlines()
        assert status == 2
        assert out == ""
        assert all(line.startswith("warning: ") for line in warned)
        assert re.fullmatch(r"error: \S.*[^.]\.", sentence)
        assert contents(self.folder) == before
        return sentence

    def fit(self, *argv, scene="scene.xml", events="events.h5", out="out"):
        out = ["--out", self.folder / out] if out else []
        return self.run(fit.main, self.folder / scene, self.folder / events, "--preset", "fast", *out, *argv)

    def fit_refused(self, *argv, scene="scene.xml", events="events.h5", out="out"):
        return self.refused(
            fit.main, self.folder / scene, self.folder / events, "--out", self.folder / out, *argv
        )

    def simulate(self, *argv, scene="scene.xml", ideal=("--ideal",), out="."):
        return self.run(simulate.main, self.folder / scene, "--out", self.folder / out, *ideal, *argv)

    def results(self, *argv, **names):
        """Fit, check what holds for all results, and give maps and summary."""
        status, _, err = self.fit(*argv, **names)
        assert status == 0, err
        folder = self.folder / names.get("out", "out")
        text = (folder / "summary.json").read_text()
        summary = json.loads(text, parse_constant=pytest.fail)  # called on NaN and infinity
        assert err.splitlines() == [f"warning: {message}" for message in summary["warnings"]]
        with np.load(folder / "maps.npz") as file:
            maps = {name: file[name] for name in file.files}
        check_maps(maps)
        return maps, summary


def contents(folder):
    """List what lies in a folder, with size and time of each file."""
    return {
        path: path.is_file() and (path.stat().st_size, path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
    }


def check_maps(maps):
    """Check what holds for the maps of any recording."""
    height, width = maps["mask"].shape
    n_band = len(maps["band_wavelength_nm"])
    assert {name: (array.shape, array.dtype.str) for name, array in maps.items()} == {
        "normal": ((height, width, 3), "<f4"),
        "reflectance": ((height, width, n_band), "<f4"),
        "mask": ((height, width), "|b1"),
        "normal_sigma_deg": ((height, width), "<f4"),
        "reflectance_sigma": ((height, width, n_band), "<f4"),
        "band_wavelength_nm": ((n_band,), "<f4"),
    }
    mask = maps["mask"]
    assert all(np.isfinite(array).all() for array in maps.values())
    np.testing.assert_allclose(np.linalg.norm(maps["normal"], axis=-1), 1, atol=1e-5)
    assert maps["normal"][..., 2].min() > 0
    assert maps["reflectance"].min() >= 0
    assert (maps["normal_sigma_deg"][~mask] == 180).all() and (maps["reflectance_sigma"][~mask] == 1).all()
    assert (maps["normal_sigma_deg"][mask] < 90).all() and (maps["normal_sigma_deg"] > 0).all()
    assert (maps["reflectance_sigma"] > 0).all() and (maps["reflectance_sigma"] <= 1).all()


@pytest.fixture
def commands(place, capsys):
    return Commands(place, capsys)


def change(folder, group=None, **attributes):
    """Set attributes of events.h5, or remove those that are None."""
    with h5py.File(folder / "events.h5", "r+") as file:
        item = file[group] if group else file
        for name, value in attributes.items():
            if value is None:
                del item.attrs[name]
            else:
                item.attrs[name] = value


def replace(folder, name, table):
    """Replace a dataset of events.h5; None removes it."""
    with h5py.File(folder / "events.h5", "r+") as file:
        del file[name]
        if table is not None:
            file[name] = table


def read(folder, name):
    with h5py.File(folder / "events.h5") as file:
        return file[name][()]


# ---------------------------------------------------------------------- input that can't be used


@pytest.mark.parametrize("name", ["scene.xml", "events.h5"])
def test_missing_input(commands, name):
    (commands.folder / name).unlink()
    assert f"{name}: " in commands.fit_refused()


@pytest.mark.parametrize("option", ["--truth", "--mask"])
def test_missing_file_of_an_option(commands, option):
    missing = commands.folder / "missing.npy"
    assert f"{missing}: " in commands.fit_refused(option, missing)


@pytest.mark.parametrize(
    "text, words",
    [
        ("not a scene", "No document element"),
        (scene()[:900], "scene.xml"),
        (scene(shape='<shape type="spheroid" id="object"/>'), '"spheroid" not found'),
        (scene(integrator='<integrator type="path"/>'), '<integrator type="ring">'),
        (scene(sensor=camera("left") + camera("right")), 'id="camera"'),
        (scene(light=""), "'led'"),
        (scene(light=leds(1)), "number of LEDs is 1;"),
        (scene(light=leds(4)), "only 4 LEDs"),
        (scene(light=leds(8, ("blue", "ultraviolet"))), "'led_001' gives the camera no light"),
        (scene(shape=SPHERE.replace("object", "thing")), "'object'"),
        (scene(sensor=camera(width=12, height=16)), "12 x 16 pixels but the events"),
        (
            scene(shape=SPHERE.replace("<bsdf", '<point name="center" x="9" y="0" z="0"/><bsdf')),
            "does not see",
        ),
        (scene(RING.replace("</", '<integer name="max_depth" value="0"/></')), "max_depth"),
    ],
)
def test_bad_scene(commands, text, words):
    (commands.folder / "scene.xml").write_text(text)
    sentence = commands.fit_refused()
    assert "scene.xml" in sentence and words in sentence


@pytest.mark.parametrize(
    "definition, words",
    [
        ("constant_light=-0.1", "constant_light is -0.1"),
        ("constant_light=nan", "constant_light is nan"),
        ("constant_light=dark", '"dark"'),
        ("constant_light", "-D name=value"),
        ("=0.1", "-D name=value"),
        ("colour=7", "colour"),
    ],
)
@pytest.mark.parametrize("main", [fit.main, simulate.main])
def test_bad_definition(commands, main, definition, words):
    argv = [commands.folder / "scene.xml", "-D", definition, "--out", commands.folder / "new"]
    if main is fit.main:
        argv.insert(1, commands.folder / "events.h5")
    assert words in commands.refused(main, *argv)


def cut(folder):
    data = (folder / "events.h5").read_bytes()
    (folder / "events.h5").write_bytes(data[: len(data) // 2])


def backwards(folder):
    replace(folder, "CD/events", read(folder, "CD/events")[::-1].copy())


def one_polarity(folder):
    table = read(folder, "CD/events")
    table["p"] = 1
    replace(folder, "CD/events", table)


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda folder: (folder / "events.h5").write_text("x,y,p,t"), "HDF5"),
        (cut, "damaged"),
        (lambda folder: replace(folder, "CD/events", None), "CD/events is missing"),
        (lambda folder: replace(folder, "CD/events", np.zeros(9)), "CD/events must be a list of records"),
        (lambda folder: replace(folder, "CD/events", read(folder, "CD/events")[:0]), "0 events"),
        (lambda folder: replace(folder, "CD/events", read(folder, "CD/events")[:1]), "1 events"),
        (backwards, "backwards"),
        (one_polarity, "both polarities"),
        (lambda folder: change(folder, width=WIDTH // 2), "outside the sensor"),
        (lambda folder: change(folder, "sensor", contrast_threshold_on=0.0), "contrast_threshold_on"),
        (lambda folder: change(folder, "sensor", contrast_threshold_off=-0.3), "contrast_threshold_off"),
        (
            lambda folder: change(folder, "sensor", contrast_threshold_on=25.0),
            "25; write changes of natural log",
        ),
        (
            lambda folder: change(folder, "sensor", contrast_threshold_off=1e-30),
            "1e-30; write changes of natural log",
        ),
        (lambda folder: change(folder, "schedule", slot_us=-10_000.0), "slot_us"),
        (lambda folder: change(folder, "schedule", crossfade=2.0), "crossfade"),
        (lambda folder: change(folder, "sensor", refractory_us=1e9), "follow each other"),
        (lambda folder: replace(folder, "schedule/order", np.arange(9)), "lights LED 8"),
    ],
)
def test_bad_events(commands, spoil, words):
    spoil(commands.folder)
    sentence = commands.fit_refused()
    assert "events.h5: " in sentence and words in sentence


def test_object_without_events(commands):
    """All events in the film's left column, where the camera does not see the object."""
    table = read(commands.folder, "CD/events")
    table["x"] = 0
    replace(commands.folder, "CD/events", table)
    assert "events.h5: No two events" in commands.fit_refused()


def test_warnings_come_before_the_sentence(commands):
    change(commands.folder, "sensor", refractory_us=None, contrast_threshold_on=None)
    (commands.folder / "scene.xml").write_text("none")
    status, _, err = commands.fit()
    assert status == 2
    assert re.fullmatch(r"warning: .*events\.h5: sensor lacks .*\nerror: .*\n", err)


@pytest.mark.parametrize("out", ["file", "file/deeper", "scene.xml"])
@pytest.mark.parametrize("command", ["fit", "simulate"])
def test_folder_that_cannot_be_one(commands, command, out):
    (commands.folder / "file").touch()
    if command == "fit":
        sentence = commands.fit_refused(out=out)
    else:
        argv = (commands.folder / "scene.xml", "--ideal", "--rounds", 1, "--out", commands.folder / out)
        sentence = commands.refused(simulate.main, *argv)
    assert f"{commands.folder / out.partition('/')[0]}: " in sentence


def test_folder_in_the_way_is_found_before_the_work(commands, monkeypatch):
    (commands.folder / "file").touch()
    monkeypatch.setattr(fit, "fit", pytest.fail)
    monkeypatch.setattr(simulate, "render", pytest.fail)
    assert "in the way" in commands.fit_refused(out="file")
    out = ("--out", commands.folder / "file")
    assert "in the way" in commands.refused(simulate.main, commands.folder / "scene.xml", *out)


def test_folder_that_cannot_be_written(commands):
    assert "/proc/here: cannot be written" in commands.fit_refused(out="/proc/here")


def test_default_folder_in_the_way_of_the_events(commands):
    (commands.folder / "events.h5").rename(commands.folder / "events")
    sentence = commands.refused(fit.main, commands.folder / "scene.xml", commands.folder / "events")
    assert "--out" in sentence


@pytest.mark.parametrize(
    "mask, words",
    [
        (np.ones((WIDTH, HEIGHT)), f"{(HEIGHT, WIDTH)}"),
        (np.zeros((HEIGHT, WIDTH)), "no pixel of the object"),
        (np.eye(HEIGHT, WIDTH) * (np.arange(WIDTH) == 0), "no pixel of the object"),  # a corner
    ],
)
def test_bad_mask(commands, mask, words):
    np.save(commands.folder / "mask.npy", mask)
    sentence = commands.fit_refused("--mask", commands.folder / "mask.npy")
    assert "mask.npy: " in sentence and words in sentence


def test_bad_truth(commands):
    with np.load(commands.folder / "truth.npz") as file:
        arrays = {name: file[name][:-1] for name in file.files}
    np.savez(commands.folder / "truth.npz", **arrays)
    sentence = commands.fit_refused("--truth", commands.folder / "truth.npz")
    assert "truth.npz: normal is an array of float32 with shape (11, 16, 3)" in sentence


@pytest.mark.parametrize(
    "argv, words",
    [
        (["--seed", "-1"], "--seed is -1"),
        (["--seed", str(10**30)], "--seed is 1000"),
        (["--device", "gpu"], "cuda_ad_spectral"),
    ],
)
def test_bad_option_of_fit(commands, argv, words):
    assert words in commands.fit_refused(*argv)


@pytest.mark.parametrize(
    "argv, words",
    [
        (["--rounds", 0], "--rounds is 0"),
        (["--spp", 0], "--spp is 0"),
        (["--seed", -1], "--seed is -1"),
        (["--slot-us", 0], "slot_us is 0"),
        (["--slot-us", -10_000], "slot_us is -10000"),
        (["--slot-us", "nan"], "slot_us is nan"),
        (["--crossfade", 2], "crossfade is 2"),
        (["--crossfade", -0.1], "crossfade is -0.1"),
        (["--led-rise-us", -1], "led_rise_us is -1"),
        (["--pixel.contrast-threshold-on", 0], "contrast_threshold_on is 0"),
        (["--pixel.event-noise", -1], "event_noise is -1"),
        (["--pixel.cutoff-hz", 0], "cutoff_hz"),
        (["--frames", "stack.npz"], "either a scene file or --frames"),
        (["-D", "constant_light=1e4"], "scene.xml: no event"),
    ],
)
def test_bad_option_of_simulate(commands, argv, words):
    folder = commands.folder
    assert words in commands.refused(simulate.main, folder / "scene.xml", "--out", folder / "new", *argv)


def test_simulate_needs_scene_or_frames(commands):
    assert "either a scene file or --frames" in commands.refused(
        simulate.main, "--out", commands.folder / "new"
    )


def test_simulate_of_an_unseen_object(commands):
    far = SPHERE.replace("<bsdf", '<point name="center" x="9" y="0" z="0"/><bsdf')
    (commands.folder / "scene.xml").write_text(scene(shape=far))
    argv = (commands.folder / "scene.xml", "--out", commands.folder / "new")
    assert "scene.xml: no event" in commands.refused(simulate.main, *argv)


@pytest.mark.parametrize("argv", [[], ["--preset", "slow"], ["--seed", "x"], ["--unknown", "1"]])
def test_wrong_usage(argv, place, capsys):
    with pytest.raises(SystemExit) as stop:
        fit.main([str(place / "scene.xml"), *argv])
    assert stop.value.code == 2
    out, err = capsys.readouterr()
    assert out == "" and "python -m evsdr.fit" in err and "Traceback" not in err


# ---------------------------------------------------------------------- stopped


def test_stopped_while_solving(commands, monkeypatch):
    monkeypatch.setattr(decode, "solve", interrupt)
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

    class Ring(decode.LambertianRing):
        def __call__(self, *argv):
            collects.add(gc.isenabled())
            return super().__call__(*argv)

    collects = set()
    monkeypatch.setattr(decode, "LambertianRing", Ring)
    assert commands.fit()[0] == 0
    assert collects == {False} and gc.isenabled()


# ---------------------------------------------------------------------- what a fit leaves behind


def test_results(commands):
    maps, summary = commands.results("--truth", commands.folder / "truth.npz")
    names = "maps.npz normal.exr reflectance.exr normal.png reflectance.png depth.exr mesh.ply summary.json"
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
    (message,) = summary["warnings"]
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
    """Events of a sphere, solved on a plane that fills the film."""
    large = '<transform name="to_world"><scale value="5"/></transform>'
    plane = f'<shape type="rectangle" id="object">{large}{DIFFUSE}</shape>'
    (commands.folder / "plane.xml").write_text(scene(shape=plane))
    maps, summary = commands.results("--truth", commands.folder / "truth.npz", scene="plane.xml")
    assert "estimated depth" in summary["model"]["cast shadows"]
    assert summary["mae_deg"] < 6
    assert summary["numbers"]["pixels_solved"] == WIDTH * HEIGHT
    assert not maps["mask"][:, 0].any()  # dark: no events there


# ---------------------------------------------------------------------- kinds of recordings


def recover(commands, text, *argv, fit_argv=(), ideal=("--ideal",)):
    """Simulate and fit a scene; give maps and summary."""
    (commands.folder / "scene.xml").write_text(text)
    status, _, err = commands.simulate(*argv, ideal=ideal)
    assert (status, err) == (0, "")
    return commands.results("--truth", commands.folder / "truth.npz", *fit_argv)


def test_perspective_camera(commands):
    _, summary = recover(commands, scene(sensor=camera(kind="perspective")))
    assert summary["mae_deg"] < 5


def test_near_light(commands):
    _, summary = recover(commands, scene(light=leds(distance=4)))
    assert summary["model"]["LEDs"].startswith("8 in 2 bands, near: direction and fall-off per pixel")
    assert summary["mae_deg"] < 5


def test_dark_slots(commands):
    """A ring that pauses twice in each round."""
    options = simulate.Options(scene=commands.folder / "scene.xml", out=commands.folder)
    signal, _, constant_light = simulate.render(options)
    schedule = Schedule(np.array([0, 1, 2, 3, -1, 4, 5, 6, 7, -1], np.int32), 10_000.0, 1.0)
    pixel = EventPixel.ideal()
    events, on, off, start = simulate_events(signal, constant_light, schedule, 4, pixel)
    sensor = Sensor(WIDTH, HEIGHT, on, off, pixel.refractory_us)
    write_recording(commands.folder / "events.h5", Recording(events, sensor, schedule, start))
    _, summary = commands.results("--truth", commands.folder / "truth.npz")
    assert summary["mae_deg"] < 5


def test_hard_switching(commands):
    _, summary = recover(commands, scene(), "--crossfade", 0)
    assert summary["mae_deg"] < 25  # what changes while a pixel rests is lost


def test_without_triggers(commands):
    with_triggers, _ = commands.results()
    replace(commands.folder, "EXT_TRIGGER/events", None)
    without, summary = commands.results(out="without")
    assert summary["warnings"] == []
    np.testing.assert_allclose(without["normal"], with_triggers["normal"], atol=1e-3)


def test_two_leds_of_one_band(commands):
    maps, summary = recover(commands, scene(light=leds(2, ("red",))))
    assert maps["reflectance"].shape == (HEIGHT, WIDTH, 1)


@pytest.mark.slow
def test_256_leds(commands):
    text = scene(light=leds(256, ("red",)))
    _, summary = recover(commands, text, "--rounds", 1, fit_argv=("--shadows", "off"))
    assert summary["model"]["LEDs"].startswith("256 in 1 bands")
    assert summary["mae_deg"] < 8


def test_257_leds_are_too_many(commands):
    (commands.folder / "scene.xml").write_text(scene(light=leds(257)))
    assert "number of LEDs is 257;" in commands.fit_refused()


def test_adam(commands, monkeypatch):
    """An eighth of the decoder's steps, for time."""
    monkeypatch.setattr(decode.adam, "AdamSettings", partial(decode.adam.AdamSettings, n_step=200))
    _, summary = commands.results("--solver", "adam", "--truth", commands.folder / "truth.npz")
    assert summary["solver"] == "adam" and summary["numbers"]["steps"] == 200
    assert summary["mae_deg"] < 15


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_units_do_not_matter(commands, factor):
    """LEDs and constant light in another unit: the same events, the same maps."""
    one, _ = commands.results()
    (commands.folder / "scaled.xml").write_text(scene(light=leds(power=factor)))
    maps, _ = commands.results("-D", f"constant_light={0.05 * factor:g}", scene="scaled.xml", out="scaled")
    np.testing.assert_array_equal(maps["mask"], one["mask"])
    np.testing.assert_allclose(maps["normal"], one["normal"], atol=0.01)
    np.testing.assert_allclose(maps["reflectance"], one["reflectance"], rtol=0.05)


@pytest.mark.parametrize(
    "power, constant_light, threshold, limit_deg",
    [
        (1, 1e-4, 0.25, 10),
        (1e3, 0.05, 0.25, 10),
        (1e-3, 1e-4, 0.25, 10),
        (1, 3, 0.05, 10),
        (1, 0.05, 0.05, 10),
        (1, 0.05, 1.0, 30),
    ],
)
def test_extremes(commands, power, constant_light, threshold, limit_deg):
    pixel = ("--pixel.contrast-threshold-on", threshold, "--pixel.contrast-threshold-off", threshold)
    define = ("-D", f"constant_light={constant_light}")
    text = scene(light=leds(power=power))
    maps, summary = recover(commands, text, *pixel, *define, fit_argv=define)
    assert summary["median_deg"] < limit_deg


def test_extreme_veil_leaves_no_pixel_known(commands):
    """A fit that is told of far more constant light than there was."""
    maps, summary = commands.results("-D", "constant_light=1e4")
    assert not maps["mask"].any() and summary["numbers"]["pixels_known"] == 0
    nothing, contradiction = summary["warnings"]
    assert "events.h5: no pixel is known" in nothing
    assert "contradict" in contradiction


@pytest.mark.parametrize("order", [[0] * 8, [0, 4, 1, 5, 2, 6, 3, 7]])
def test_events_that_contradict_the_order_are_warned_of(commands, order):
    replace(commands.folder, "schedule/order", np.array(order, np.int32))
    _, summary = commands.results()
    assert "events.h5: the events contradict" in summary["warnings"][-1]


def test_spoilt_inverse_is_not_known(commands, monkeypatch):
    """Rounding can leave a variance below zero."""

    def solve(*argv):
        solution = lm_solve(*argv)
        solution.covariance[0, 0, 0] = -1e-9
        solution.covariance[1, 3, 3] = -1e-9
        return solution

    before, summary = commands.results()
    lm_solve = decode.lm.solve
    monkeypatch.setattr(decode.lm, "solve", solve)
    maps, spoilt = commands.results()
    assert np.count_nonzero(before["mask"] & ~maps["mask"]) == 2
    assert spoilt["numbers"]["pixels_known"] == summary["numbers"]["pixels_known"] - 2


def test_photographs(commands):
    """A stack of photographs, simulated and solved with the scene.xml that comes with it."""
    (commands.folder / "scene.xml").write_text(scene(light=leds(N_LED, ("red",))))
    options = simulate.Options(scene=commands.folder / "scene.xml", out=commands.folder)
    frames, truth, _ = simulate.render(options)
    angle = 2 * np.pi * np.arange(N_LED) / N_LED
    direction = np.column_stack([np.cos(angle), np.sin(angle), np.ones(N_LED)])
    known = dict(normal=truth.normal, reflectance=truth.reflectance, mask=truth.mask)
    np.savez(commands.folder / "stack.npz", frames=frames, light_direction=direction, **known)
    argv = ("--frames", commands.folder / "stack.npz", "--out", commands.folder / "stack", "--ideal")
    assert commands.run(simulate.main, *argv)[0] == 0
    _, summary = commands.results(
        "--truth", commands.folder / "stack" / "truth.npz", scene="stack/scene.xml", events="stack/events.h5"
    )
    assert summary["mae_deg"] < 5


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
    code = f"import atexit, sys; from evsdr.{name} import main; {at_exit}; main()"
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
