"""Experiments use what `evsdr` exports, and beyond it only the modules that they measure."""

import ast

import pytest

import evsdr
from tests.conftest import REPOSITORY

EXPERIMENTS = REPOSITORY / "experiments"
# Modules that an experiment measures, draws with, or must start before them.
MEASURED = {
    "ablation": {"solve.tuning"},
    "batch": {"jobs"},
    "bench": {"calibration.thresholds", "commands.console", "rig", "events.phase", "fitting.simulation"},
    "benchmark.py": {"jit"},
    "cast_shadow": {"light", "effects.world"},  # tells where shadows are, and traces none
    "colour_chart": {"files.daylight"},
    "daylight_table.py": {"files.daylight"},
    "draws": {
        "fitting.simulation",
        "rig",
        "scenes",
    },  # writes rings, gives rendered images to other event pixels
    "extremes": {"jit"},  # which Mitsuba's transformations need first
    "fuzz": {"files", "rig", "calibration", "jit"},
    "gloss": {"fitting.simulation", "light"},  # adds a lobe to rendered images
    "lamp.py": {"events"},
    "limit": {"limits", "jit", "events", "model", "solve"},  # fits single pixels under the model's own light
    "materials": {"events.record", "fitting.simulation", "light"},  # wraps light around rendered images
    "near_leds.py": {"light"},  # tells where the surface is
    "picture.py": {"files.daylight"},
    "real_frames": {"files.photographs"},
    "shared": {"solve.shared"},
    "fitting.py": {"threads"},
    "speed_accuracy": {"fitting.budget"},
    "stages.py": {"rig", "__version__"},
    "sigma": {"fitting.simulation", "solve.shared"},  # gives rendered images to another event pixel
    "view_faults.py": {"viewing", "fitting.simulation"},  # spoils rendered images
    "table1": {"jit", "scenes"},  # renders by stock Mitsuba
}
FILES = sorted(path.relative_to(EXPERIMENTS) for path in EXPERIMENTS.rglob("*.py"))


def imported(path):
    """Give the names below evsdr that a file imports, and those it takes as attributes of evsdr."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "evsdr":
            yield from (".".join([*node.module.split(".")[1:], alias.name]) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name[6:] for alias in node.names if alias.name.startswith("evsdr."))
        elif (
            isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "evsdr"
        ):
            yield node.attr


@pytest.mark.parametrize("file", FILES, ids=str)
def test_it_imports_what_is_public_or_measured(file):
    allowed = MEASURED.get(file.parts[0], set())
    for name in imported(EXPERIMENTS / file):
        public = name in evsdr.__all__
        assert public or any(f"{name}.".startswith(f"{module}.") for module in allowed), name
