"""`python -m evsdr.view`: a page and a verdict, or one sentence."""

import h5py
import numpy as np
import pytest

from evsdr.commands import view
from tests.support.command_line import change, read, replace


def test_a_page_and_a_verdict(commands, place):
    status, out, err = commands.run(view.main, place / "events.h5")
    assert (status, err) == (0, "")
    assert "good: Nothing speaks against this recording." in out
    assert f"{place / 'events.view.html'}: open it in a browser." in out.replace("\n", " ")
    text = (place / "events.view.html").read_text()
    assert "evsdr view 1" in text and "http" not in text.replace("http://www.w3.org/2000/svg", "").replace(
        "http-equiv", ""
    )


def test_with_its_scene(commands, place):
    status, out, _ = commands.run(
        view.main, place / "events.h5", place / "scene.xml", "--out", place / "page.html"
    )
    assert status == 0
    assert "scene: It goes with the events" in out and "at best (1 sigma, median)" in out
    assert "normals at best" in (place / "page.html").read_text()


def test_what_contradicts_gives_3(commands, place):
    change(place, "schedule", slot_us=10 * read_slot(place))
    status, out, _ = commands.run(view.main, place / "events.h5")
    assert status == 3
    assert "contradicted: The recording contradicts what is told of it" in out
    assert (place / "events.view.html").exists()


def read_slot(place):
    with h5py.File(place / "events.h5") as file:
        return float(file["schedule"].attrs["slot_us"])


def test_a_recording_without_schedule(commands, place):
    replace(place, "schedule", None)
    status, out, _ = commands.run(view.main, place / "events.h5", place / "scene.xml")
    assert status == 0
    assert "without a schedule little can be told" in out


@pytest.mark.parametrize(
    "argv, words",
    [
        (("none.h5",), "there is no such file"),
        (("scene.xml",), "neither"),
        (("events.h5", "none.xml"), "none.xml"),
        (("events.h5", "--out", "events.h5"), "this is one of the files to look at"),
        (("events.h5", "--out", "none/page.html"), "none"),
        (("events.h5", "--ring", "scene.xml"), "scene.xml"),
        (("events.h5", "-D", "width"), "-D name=value"),
    ],
)
def test_what_cannot_be_used(commands, place, argv, words):
    paths = [str(place / word) if word.endswith((".h5", ".xml", ".html")) else word for word in argv]
    assert words in commands.refused(view.main, *paths)


def test_a_scene_of_another_size(commands, place):
    change(place, width=17)
    assert "the film is 16 x 12 pixels" in commands.refused(
        view.main, place / "events.h5", place / "scene.xml"
    )


def test_events_at_one_time(commands, place):
    table = read(place, "CD/events")
    table["t"] = 5
    replace(place, "CD/events", table)
    assert "events at one time" in commands.refused(view.main, place / "events.h5")
    assert np.ptp(read(place, "CD/events")["t"]) == 0
