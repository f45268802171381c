"""The blob, its mesh and picked points of it, for poses; few events, for speed."""

import numpy as np
import pytest

from tests.conftest import REPOSITORY


@pytest.fixture(autouse=True)
def few_events(monkeypatch):
    """Enough for the accuracy asked for, and quick."""
    for name in ("powers", "leds"):
        monkeypatch.setattr(f"evsdr.calibration.{name}.MOST_EVENTS", 12_000)


@pytest.fixture(scope="session")
def blob():
    """The blob as its scene shows it, and its mesh."""
    from evsdr.calibration.pose import read_model  # late: they need Mitsuba started
    from evsdr.light.camera import view_of
    from evsdr.light.ground_truth import surface_maps
    from evsdr.light.scene import load_scene
    from evsdr.light.tracing import trace_illumination

    ring = load_scene(REPOSITORY / "scenes" / "blob.xml", {"size": "96"})
    _, coverage = trace_illumination(ring, 16, False)
    truth = surface_maps(ring, 4)
    mesh, model = read_model(REPOSITORY / "scenes" / "blob.ply", 1.0)
    return view_of(ring), coverage >= 0.5, truth, mesh, model


@pytest.fixture(scope="session")
def points(blob):
    """Ten picked points, 0.3 pixels wrong."""
    view, _, _, mesh, _ = blob
    rng = np.random.default_rng(0)
    point = mesh.vertices[rng.choice(len(mesh.vertices), 10)]
    return view.project(view.point_to_camera(point)) + rng.normal(0, 0.3, (10, 2)), point
