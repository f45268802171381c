"""Kinds of rings, cameras and recordings, recovered by the commands."""

from functools import partial

import numpy as np
import pytest

from evsdr.commands import simulate
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.files.events_h5 import write_recording
from evsdr.fitting import decoder
from evsdr.fitting.simulation import render
from evsdr.light.entry import open_scene
from evsdr.records import Recording, Schedule, Sensor
from tests.support.command_line import N_LED, replace
from tests.support.small_scene import HEIGHT, WIDTH, camera, leds, scene


def recover(commands, text, *argv, fit_argv=(), ideal=("--ideal",)):
    """Simulate and fit a scene; give maps and summary."""
    (commands.folder / "scene.xml").write_text(text)
    status, _, err = commands.simulate(*argv, ideal=ideal)
    assert (status, [line for line in err.splitlines() if not line.startswith("simulate: ")]) == (0, [])
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
    ring = open_scene(commands.folder / "scene.xml")
    signal, _ = render(ring)
    schedule = Schedule(np.array([0, 1, 2, 3, -1, 4, 5, 6, 7, -1], np.int32), 10_000.0, 1.0)
    pixel = EventPixel.ideal()
    events, on, off, start = simulate_events(signal, ring.constant_light, schedule, 4, pixel)
    sensor = Sensor(WIDTH, HEIGHT, on, off, pixel.refractory_us)
    write_recording(commands.folder / "events.h5", Recording(events, sensor, schedule, start))
    _, summary = commands.results("--truth", commands.folder / "truth.npz")
    assert summary["mae_deg"] < 5


def test_hard_switching(commands):
    """What changes while a pixel rests is lost: the fit says that it is doubtful.

    Its sigmas are not true there: over other seeds 25 to 80 % of the known pixels lie within three, before and after any mend.
    """
    maps, summary = recover(commands, scene(), "--crossfade", 0)
    assert summary["verdict"].startswith("doubtful: ")
    known = maps["mask"]
    assert np.count_nonzero(known) < 0.5 * known.size or summary["mae_deg"] < 35


def test_photoreceptors_that_lag_tell_what_hard_switches_hide(commands):
    """The events of an EVK4 after a switch say how its photoreceptors follow; whole slots of 20 ms are steady."""
    commands.simulate("--crossfade", 0, ideal=())
    _, summary = commands.results("--preset", "balanced", "--truth", commands.folder / "truth.npz")
    assert summary["model"]["photoreceptor lag"].startswith("as found: events are ")
    assert summary["mae_deg"] < 5


def test_without_triggers(commands):
    with_triggers, _ = commands.results()
    replace(commands.folder, "EXT_TRIGGER/events", None)
    without, summary = commands.results(out="without")
    assert summary["warnings"] == []
    off = np.abs(without["normal"] - with_triggers["normal"]).max(axis=-1)
    assert np.mean(off > 0.02) < 0.02  # pixels of few events have other minima


def test_two_leds_of_one_band(commands):
    maps, summary = recover(commands, scene(light=leds(2, ("red",))))
    assert maps["reflectance"].shape == (HEIGHT, WIDTH, 1)


@pytest.mark.slow
def test_128_leds(commands):
    """Half as many as there may be: all 256, which `experiments.extremes` has, take half a minute to compile."""
    text = scene(light=leds(128, ("red",)), sensor=camera(width=8, height=8))
    _, summary = recover(commands, text, "--rounds", 1, fit_argv=("--shadows", "off"))
    assert summary["model"]["LEDs"].startswith("128 in 1 bands")
    assert summary["mae_deg"] < 8


def test_257_leds_are_too_many(commands):
    (commands.folder / "scene.xml").write_text(scene(light=leds(256)))
    assert open_scene(commands.folder / "scene.xml").leds.n_led == 256
    (commands.folder / "scene.xml").write_text(scene(light=leds(257)))
    assert "number of LEDs is 257;" in commands.fit_refused()


def test_adam(commands, monkeypatch):
    """An eighth of the decoder's steps, for time."""
    monkeypatch.setattr(
        decoder.published, "AdamSettings", partial(decoder.published.AdamSettings, n_step=200)
    )
    _, summary = commands.results("--solver", "adam", "--truth", commands.folder / "truth.npz")
    assert summary["solver"] == "adam" and summary["numbers"]["steps"] == 200
    assert summary["mae_deg"] < 15


def test_units_do_not_matter(commands):
    """LEDs and constant light in another unit: the same events, the same maps."""
    one, _ = commands.results()
    (commands.folder / "scaled.xml").write_text(scene(light=leds(power=1e3)))
    maps, _ = commands.results("-D", "constant_light=50", scene="scaled.xml", out="scaled")
    np.testing.assert_array_equal(maps["mask"], one["mask"])
    np.testing.assert_allclose(maps["normal"], one["normal"], atol=0.01)
    off = np.abs(maps["reflectance"] - one["reflectance"])
    assert (off < np.maximum(0.05 * one["reflectance"], one["reflectance_sigma"])).all()


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
    maps, summary = commands.results("-D", "constant_light=1e4", status=3)
    assert not maps["mask"].any() and summary["numbers"]["pixels_known"] == 0
    nothing, contradiction = summary["warnings"]
    assert "events.h5: no pixel is known" in nothing
    assert "contradict" in contradiction


@pytest.mark.parametrize("order", [[0] * 8, [0, 4, 1, 5, 2, 6, 3, 7]])
def test_events_that_contradict_the_order_are_warned_of(commands, order):
    replace(commands.folder, "schedule/order", np.array(order, np.int32))
    _, summary = commands.results(status=3)
    assert "events.h5: the events contradict" in summary["warnings"][-1]


def test_spoilt_inverse_is_not_known(commands, monkeypatch):
    """Rounding can leave a variance below zero."""

    def solve(*argv):
        solution = lm_solve(*argv)
        solution.covariance[0, 0, 0] = -1e-9
        solution.covariance[1, 3, 3] = -1e-9
        return solution

    before, summary = commands.results()
    lm_solve = decoder.run
    monkeypatch.setattr(decoder, "run", solve)
    maps, spoilt = commands.results()
    assert np.count_nonzero(before["mask"] & ~maps["mask"]) == 2
    assert spoilt["numbers"]["pixels_known"] == summary["numbers"]["pixels_known"] - 2


def test_photographs(commands):
    """A stack of photographs, simulated and solved with the scene.xml that comes with it."""
    (commands.folder / "scene.xml").write_text(scene(light=leds(N_LED, ("red",))))
    frames, truth = render(open_scene(commands.folder / "scene.xml"))
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
