"""A scene is opened whether Mitsuba runs or not."""

import os
import subprocess
import sys

import pytest

from evsdr.errors import InputError
from evsdr.light.entry import open_scene
from tests.conftest import REPOSITORY
from tests.support.small_scene import HEIGHT, WIDTH, scene


def test_it_takes_what_the_file_defines(tmp_path):
    (tmp_path / "scene.xml").write_text(scene())
    ring = open_scene(tmp_path / "scene.xml", {"constant_light": "0.125"})
    assert (ring.width, ring.height, ring.constant_light) == (WIDTH, HEIGHT, 0.125)
    with pytest.raises(InputError, match="absent.xml: no such file"):
        open_scene(tmp_path / "absent.xml")


def test_it_starts_mitsuba_where_nobody_has(tmp_path):
    (tmp_path / "scene.xml").write_text(scene())
    code = (
        "import sys\nfrom evsdr.light.entry import open_scene\nassert 'mitsuba' not in sys.modules\n"
        "print(open_scene('scene.xml').leds.n_led)"
    )
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY)}
    child = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert child.stdout == "8\n", child.stderr
