"""Tests mirror the rooms: each module has a test file of its name, in the folder of its room."""

from pathlib import PurePath

import pytest

from tests.conftest import REPOSITORY

ROOMS = (
    "model",
    "events",
    "files",
    "light",
    "shape",
    "solve",
    "effects",
    "fitting",
    "limits",
    "calibration",
    "page",
    "exports",
    "jobs",
    "rig",
    "viewing",
    "preview",
)
# Modules that need no test file of their own, and why.
WITHOUT = {
    f"{door}.py": "five lines, run by test_package.py"
    for door in (
        *(
            "batch",
            "calibrate",
            "capture",
            "convert",
            "design",
            "export",
            "fit",
            "new_scene",
            "ring",
            "simulate",
        ),
        *("view", "live"),
    )
}
# Modules that others' tests reach so far. The list only shrinks.
OPEN = {
    "solve/neighbours/spectra.py",
}

MODULES = sorted(
    path.relative_to(REPOSITORY / "evsdr").as_posix()
    for room in (*ROOMS, ".")
    for path in (REPOSITORY / "evsdr" / room).glob("*.py" if room == "." else "**/*.py")
    if path.stem != "__init__"
)


@pytest.mark.parametrize("module", MODULES)
def test_every_module_has_a_test_of_its_name(module):
    path = PurePath(module)
    own = REPOSITORY / "tests" / path.parent / f"test_{path.name}"
    if module not in WITHOUT and module not in OPEN:
        assert own.exists(), f"write {own.relative_to(REPOSITORY)}"
