"""What the commands say of input that can't be used, and that nothing of it stays."""

import re

import numpy as np
import pytest

from evsdr.commands import fit, simulate
from tests.support.command_line import change, read, replace
from tests.support.small_scene import HEIGHT, RING, SPHERE, WIDTH, camera, leds, scene


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
    monkeypatch.setattr(fit, "recover", pytest.fail)
    monkeypatch.setattr("evsdr.fitting.simulation.render", pytest.fail)
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
