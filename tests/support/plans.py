"""Recordings to be made of a few pixels under the ring of `analytic`."""

import mitsuba as mi
import numpy as np

from evsdr.events.pixel import EventPixel
from evsdr.limits.information import Plan
from evsdr.model.illumination import Illumination
from evsdr.records import Schedule
from tests.support.analytic import ring_directions
from tests.support.sphere import C_W, SPECTRUM

PIXEL = EventPixel(0.2, 0.2, event_noise=0.1).idealised()
SCHEDULE = Schedule(np.arange(24), 10_000.0, 1.0)


def plan_of(normal, mask=None, constant_light=C_W, schedule=SCHEDULE, pixel=PIXEL, n_round=6) -> Plan:
    """Plan a recording of normals (height, width, 3), all of one spectrum."""
    mask = np.ones(normal.shape[:2], bool) if mask is None else mask
    light = Illumination(
        [mi.Vector3f(*d) for d in ring_directions().tolist()],
        [mi.Float(1.0)] * 24,
        [j % 8 for j in range(24)],
        mi.Float(constant_light),
    )
    reflectance = np.broadcast_to(SPECTRUM, (*mask.shape, 8))
    return Plan(normal, reflectance, mask, light, schedule, n_round, pixel)


def many(normal, n: int) -> np.ndarray:
    """Give a row of n pixels (1, n, 3) that all have the direction of one normal."""
    normal = np.asarray(normal, float)
    return np.broadcast_to(normal / np.linalg.norm(normal), (1, n, 3))
