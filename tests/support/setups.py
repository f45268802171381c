"""A recorded sphere, and its fit when nothing but events and files has been looked at."""

from dataclasses import replace
from functools import cache

import numpy as np

from evsdr import Settings
from evsdr.events.pixel import EventPixel
from evsdr.fitting.decoder import Decoder, start_normals
from evsdr.fitting.simulation import simulate
from evsdr.light.entry import open_scene
from evsdr.records import Schedule
from tests.conftest import REPOSITORY
from tests.support.worlds import world_of

SIZE = 24
PIXEL = EventPixel(event_noise=0.1).idealised()


def scene_of(name="sphere", constant_light="0.05"):
    """Load a scene of the repository."""
    define = {"size": str(SIZE), "constant_light": constant_light}
    return open_scene(REPOSITORY / "scenes" / f"{name}.xml", define)


@cache
def recorded(name="sphere", crossfade=1.0):
    """Record a scene with a noise of a tenth of the thresholds; gives the truth, too."""
    ring = scene_of(name)
    schedule = Schedule(np.arange(ring.leds.n_led, dtype=np.int32), 20_000.0, crossfade)
    return simulate(ring, PIXEL, schedule, rounds=4)


def fitted_alone(ring, recording, thresholds=False):
    """Give the world and a fit of pixels that are each alone."""
    world = replace(world_of(ring, recording), thresholds=thresholds)
    solve = Decoder(ring, Settings(), start_normals(ring, "frontal"), thresholds)
    return world, solve(world.problem(), None, "rough")
