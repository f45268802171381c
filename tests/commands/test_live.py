"""`python -m evsdr.live`: maps, figures and a picture, or one sentence."""

import re

import pytest

from evsdr.commands import live
from tests.support.command_line import change


def test_maps_beside_preset_fast(commands, place):
    status, out, err = commands.run(
        live.main, "--truth", place / "truth.npz", place / "events.h5", place / "scene.xml"
    )
    assert (status, err) == (0, "")
    found = {name: float(value) for name, value in re.findall(r"│ ([\w: ]+deg) +│ +([\d.]+) │", out)}
    assert 0 < found["fast: median_deg"] < found["median_deg"] < 5
    assert (place / "events.live.png").exists()


@pytest.mark.parametrize(
    "more, words",
    [
        (("--rounds", "0"), "--rounds is 0"),
        (("--maps-hz", "nan"), "--maps-hz is nan"),
        (("--rounds", "9"), "--rounds 9"),
        (("--out", "events.h5"), "this is one of the files to read"),
        (("--out", "none/live.png"), "there is no folder"),
        (("-D", "width"), "-D name=value"),
    ],
)
def test_what_cannot_be_used(commands, place, more, words):
    more = [str(place / word) if word.endswith((".h5", ".png")) else word for word in more]
    assert words in commands.refused(live.main, place / "events.h5", place / "scene.xml", *more)


def test_a_recording_of_another_size(commands, place):
    change(place, width=17)
    assert "make the film as large" in commands.refused(live.main, place / "events.h5", place / "scene.xml")
