"""Commands as a shell runs them: in a process where nobody has started Mitsuba."""

import os
import subprocess
import sys

import pytest

from tests.conftest import REPOSITORY

SCENE = str(REPOSITORY / "scenes" / "sphere.xml")


def run(*words, folder):
    command = [sys.executable, "-m", *words]
    return subprocess.run(
        command, cwd=folder, env=os.environ | {"PYTHONPATH": str(REPOSITORY)}, capture_output=True, text=True
    )


@pytest.mark.parametrize(
    ("words", "file"),
    [
        (["evsdr.calibrate", "reference", SCENE], "calibrate_reference/reference.csv"),
        (["evsdr.design", SCENE, "-D", "size=8", "--rounds", "1", "--spp", "1"], "design_sphere/design.json"),
    ],
)
def test_it_starts_mitsuba_in_time(words, file, tmp_path):
    ended = run(*words, folder=tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "out" / file).is_file()


@pytest.mark.parametrize("action", ["directions", "powers", "pose"])
def test_what_needs_mitsuba_for_its_imports_refuses_in_a_sentence(action, tmp_path):
    other = ["events.h5:0,0,1"] if action == "powers" else ["absent"]
    ended = run("evsdr.calibrate", action, "absent.xml", *other, folder=tmp_path)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1), ended.stderr
    assert ended.stderr.startswith("error: absent.xml: ")
