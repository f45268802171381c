"""The rooms of the code: imports go down, and only a few rooms know Mitsuba, the terminal and options."""

import ast

import pytest

from tests.conftest import REPOSITORY

tomllib = pytest.importorskip("tomllib")  # from Python 3.11 on

# What may be imported lies on a floor below, or in the same room.
FLOORS = (
    ("errors", "records", "progress", "signals", "threads"),
    ("model", "metrics"),
    ("integrators", "events", "files", "jit", "frozen"),
    ("solve", "light", "shape", "rig"),
    ("effects", "limits", "calibration", "page", "exports", "jobs"),
    ("fitting",),
    ("viewing", "preview"),
    ("commands", "scenes", "door"),
)
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
DOORS = (
    *("fit", "simulate", "design", "calibrate", "convert", "capture", "ring", "export", "batch", "new_scene"),
    *("view", "live"),
)
ONLY_IN = {
    "mitsuba": ("light", "integrators", "jit"),
    "tyro": ("commands",),
    "rich": ("commands", "progress"),
}

MODULES = {
    ("evsdr", *path.relative_to(folder).with_suffix("").parts): path
    for folder in (REPOSITORY / "evsdr",)
    for path in folder.rglob("*.py")
} | {("evsdr", "integrators", path.stem): path for path in (REPOSITORY / "integrators").glob("*.py")}


def imports(path):
    """Give the dotted names that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def room(name):
    """Give the room of a dotted name, None for what lies outside or is the package itself."""
    parts = name.split(".")
    return parts[1] if parts[0] == "evsdr" and len(parts) > 1 and parts[1] in FLOOR else None


@pytest.mark.parametrize("name", sorted(MODULES), ids=".".join)
def test_imports_go_down(name):
    here = name[1]
    if here in (*DOORS, "__init__"):
        return
    for imported in imports(MODULES[name]):
        there = room(imported)
        if there and there != here:
            same_floor = FLOOR[there] == FLOOR[here] and (there in FLOORS[0] or here in ("jit", "metrics"))
            assert FLOOR[there] < FLOOR[here] or same_floor, f"{'.'.join(name)} imports {imported}"


@pytest.mark.parametrize("library", ONLY_IN)
def test_few_rooms_know(library):
    knows = {
        name[1]
        for name, path in MODULES.items()
        if any(imported.split(".")[0] == library for imported in imports(path))
    }
    assert knows <= set(ONLY_IN[library])


def test_every_room_is_packaged():
    packages = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    folders = {path.parent for path in (REPOSITORY / "evsdr").rglob("__init__.py")}
    rooms = {".".join(folder.relative_to(REPOSITORY).parts) for folder in folders}
    assert set(packages) == rooms | {"evsdr.integrators", "evsdr.scenes"}


def test_no_test_imports_from_a_test():
    for path in (REPOSITORY / "tests").rglob("*.py"):
        taken = [name for name in imports(path) if name.startswith("tests.")]
        assert all(name.split(".")[1] in ("support", "conftest") for name in taken), path


@pytest.mark.parametrize("name", ["analytic", "brute_pixel", "event_reference"])
def test_references_know_nothing_of_what_they_judge(name):
    path = REPOSITORY / "tests" / "support" / f"{name}.py"
    assert set(imports(path)) <= {"numpy", "typing", "typing.NamedTuple"}
