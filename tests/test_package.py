"""What is installed, and that a bare checkout works like it."""

import importlib
import os
import re
import subprocess
import sys

import pytest

import evsdr
from tests.conftest import REPOSITORY

tomllib = pytest.importorskip("tomllib")  # from Python 3.11 on

PYPROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]


def test_every_command_has_a_console_script_that_leads_to_a_function():
    doors = {
        file.stem for file in (REPOSITORY / "evsdr").glob("*.py") if "open_door(" in file.read_text()
    } - {"door"}
    assert PROJECT["scripts"] == {
        f"evsdr-{door.replace('_', '-')}": f"evsdr.commands.{door}:main" for door in doors
    }
    assert doors == set(DOORS)
    for door in doors:
        assert callable(importlib.import_module(f"evsdr.commands.{door}").main)


@pytest.mark.parametrize("module", ["evsdr", "evsdr.jit", "evsdr.records", "evsdr.errors"])
def test_import_is_cheap(module):
    heavy = {"mitsuba", "drjit", "numba", "scipy"}
    code = f"import sys, {module}; print(*({heavy} & set(sys.modules)))"
    assert _run(code, REPOSITORY, {}) == ""


DOORS = (
    *("fit", "simulate", "design", "calibrate", "convert", "capture", "ring", "export", "batch", "new_scene"),
    *("view", "live"),
)


@pytest.mark.parametrize("door", DOORS)
def test_help_is_cheap(door):
    heavy = {"mitsuba", "drjit", "colour", "scipy", "numba", "matplotlib", "trimesh", "OpenEXR"}
    code = (
        f"import sys, io, contextlib\nfrom evsdr.commands.{door} import main\n"
        "with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n"
        "    main(['--help'])\n"
        f"print(*({heavy} & set(sys.modules)))"
    )
    assert _run(code, REPOSITORY, {}) == ""


def test_bare_checkout_imports_what_lies_beside_the_package(tmp_path):
    code = "import evsdr.integrators, evsdr.scenes; print(evsdr.integrators.__file__)"
    file = _run(code, tmp_path, {"PYTHONPATH": str(REPOSITORY)})
    assert file == str(REPOSITORY / "integrators" / "__init__.py")


def test_every_file_of_the_scenes_is_packaged():
    scenes = REPOSITORY / "scenes"
    patterns = PYPROJECT["tool"]["setuptools"]["package-data"]["evsdr.scenes"]
    packaged = {file for pattern in patterns for file in scenes.glob(pattern)}
    data = {file for file in scenes.rglob("*.*") if file.suffix not in {".py", ".pyc", ".md"}}
    assert scenes / "sphere_pole.xml" in data
    assert data - packaged == set()


def test_every_table_of_the_package_is_packaged():
    data = PYPROJECT["tool"]["setuptools"]["package-data"]
    package = REPOSITORY / "evsdr"
    files = {
        file
        for file in package.rglob("*.*")
        if file.suffix in {".csv", ".npz", ".json", ".txt", ".html", ".css", ".js"}
    }
    assert {package / "files" / "daylight.csv", package / "page" / "main.js"} <= files
    for file in files:
        name = ".".join(file.parent.relative_to(REPOSITORY).parts)
        assert any(file.match(pattern) for pattern in data.get(name, ())), file


def test_every_dependency_has_one_exact_version():
    pins = (REPOSITORY / ".ci" / "constraints.txt").read_text()
    wanted = PROJECT["dependencies"] + [
        line for extra in PROJECT["optional-dependencies"].values() for line in extra if "[" not in line
    ]
    for name in ["pip", "setuptools", *(re.match(r"[\w-]+", line)[0] for line in wanted)]:
        assert re.search(rf"^{name}==\S+", pins, re.MULTILINE), f"{name} has no version"
    exact = [line for line in wanted if "==" in line]
    assert exact
    for line in exact:
        assert line in pins.splitlines()


def test_version_is_in_the_changelog():
    assert f"## [{evsdr.__version__}]" in (REPOSITORY / "CHANGELOG.md").read_text()


def _run(code, folder, variables):
    command = [sys.executable, "-c", code]
    environment = os.environ | variables
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return run.stdout.strip()
