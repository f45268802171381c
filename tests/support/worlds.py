"""What effects decide on: the worlds of scenes, and small ones without Mitsuba's."""

from dataclasses import dataclass, replace

import numpy as np

from evsdr.effects.world import Terms, World
from evsdr.events.pairs import pair_events
from evsdr.light.scene import RingScene, load_scene
from evsdr.light.tracing import trace_illumination
from evsdr.solve.problem import make_problem
from tests.support.small_scene import DIFFUSE, camera, scene


def load(tmp_path, text: str) -> RingScene:
    """Load a scene from its text."""
    (tmp_path / "scene.xml").write_text(text)
    return load_scene(tmp_path / "scene.xml")


def world_of(ring: RingScene, recording=None, **terms) -> World:
    """Give the world of a scene before any fit."""
    _, coverage = trace_illumination(ring, 4, False, 1)
    return World.before_a_fit(ring, recording, np.asarray(coverage) >= 0.5, Terms(**terms))


def small_ball(distance: float) -> str:
    """Write a ball before the sphere; it moves away to the side, so that its shadow leaves the sphere."""
    return f"""<shape type="sphere" id="ball"><point name="center" x="{distance}" y="0" z="0.9"/>
        <float name="radius" value="0.1"/>{DIFFUSE}</shape>"""


def with_ball(distance: float) -> str:
    """Write a scene of the sphere and that ball."""
    sphere = f'<shape type="sphere" id="object">{DIFFUSE}</shape>'
    return scene(shape=sphere + small_ball(distance), sensor=camera(width=48, height=48))


@dataclass(frozen=True)
class SmallWorld:
    """A recording, its light, and what effects may change."""

    recording: object
    light: object = None
    mask: np.ndarray | None = None
    terms: Terms = Terms()
    metal: float | None = None
    thresholds: bool = False
    hot: np.ndarray | None = None
    lag: object = None

    def illumination(self):
        return self.light

    def problem(self):
        return problem_of(self.recording, self.light, self.mask)


def problem_of(recording, light, mask, order=None):
    """Give the solver's view of a recording, maybe with another order of the LEDs."""
    if order is not None:
        recording = replace(recording, schedule=replace(recording.schedule, order=order))
    return make_problem(recording, pair_events(recording, mask), light, mask)
