"""One name for one thing over all commands, and one default."""

import dataclasses
import importlib

import pytest

from evsdr.commands import design, simulate
from evsdr.commands.calibrate import Directions, FromFit, Pose, Powers, Reference, Scale, Thresholds
from evsdr.commands.pixel import Pixel
from evsdr.events.pixel import EventPixel

COMMANDS = ("batch", "capture", "convert", "design", "export", "fit", "new_scene", "ring", "simulate")
# Names that mean different things, or whose defaults must differ, and why.
EXCEPTED = {
    "constant_light": "C_w of a scene or of photographs; a switch of the ring",
    "thresholds": "what a fit does with them, what a recording tells of them, a file of them",
    "leds": "what a fit models; a table",
    "events": "a recording",
    "scene": "not needed with photographs",
    "spp": "of a simulation it depends on the scene",
    "unit": "of a CAD model, a number; of a scene, a name",
    "out": "results, or where a log goes",
    "mask": "of a ball, of a silhouette, of what is solved",
    "radius": "of a ball",
}


def defaults(options):
    """Give the name and the default of each option that has one."""
    for field in dataclasses.fields(options):
        missing = field.default is dataclasses.MISSING
        yield field.name, None if missing else field.default


def test_one_default_for_each_name():
    kinds = [importlib.import_module(f"evsdr.commands.{name}").Options for name in COMMANDS]
    kinds += [Directions, Powers, Thresholds, Reference, Scale, Pose, FromFit]
    found = {}
    for kind in kinds:
        for name, default in defaults(kind):
            if default is not None and name not in EXCEPTED:
                found.setdefault(name, []).append((default, f"{kind.__module__}.{kind.__name__}"))
    assert len(found["crossfade"]) >= 4
    for name, told in found.items():
        assert len({repr(default) for default, _ in told}) == 1, (name, told)


def test_the_pixel_of_the_commands_is_that_of_the_library():
    assert dataclasses.asdict(Pixel()) == dataclasses.asdict(EventPixel())


@pytest.mark.parametrize("command", [simulate, design])
@pytest.mark.parametrize(
    "name, field",
    [
        ("--threshold-on", "contrast_threshold_on"),
        ("--pixel.contrast-threshold-on", "contrast_threshold_on"),
        ("--threshold-off", "contrast_threshold_off"),
        ("--refractory-us", "refractory_us"),
        ("--event-noise", "event_noise"),
        ("--noise", "event_noise"),
    ],
)
def test_short_and_long_names(monkeypatch, command, name, field):
    got = []
    monkeypatch.setattr(command, "command", got.append)
    assert command.main(["scene.xml", "--out", "x", name, "0.3125"]) == 0
    assert getattr(got[0].pixel, field) == 0.3125
