"""A world, a fit, and what was found of all pixels: by hand, for the effects that take their part of it."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.memo import Memo
from evsdr.effects.shared import SharedFound
from evsdr.effects.world import Terms
from evsdr.records import Recording, Schedule, Sensor
from evsdr.solve.shared.infer import Inferred
from evsdr.solve.shared.rig import GROUPS, N_TIMING, NAMES, Rig, Told

N_LED, SLOT_US = 3, 1000.0


def rig(**values) -> Rig:
    """Give a rig of three LEDs that is as told but for some values; times in slots."""
    zero = Rig(np.zeros(N_LED), 0.0, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, np.zeros(2), np.zeros((N_LED, 2)))
    return replace(zero, **values)


def found(turn_deg=0.2, told=Told(), names=NAMES, **values) -> SharedFound:
    """Give what was found, by default powers, thresholds and a leak that are off; sigmas are a hundredth."""
    values = {
        "log_power": np.array([0.05, -0.05, 0.0]),
        "log_threshold": np.full(2, 0.1),
        "leak": 0.1,
    } | values
    sigma = Rig.of(np.full(3 * N_LED + N_TIMING, 0.01), N_LED)
    turn = dict.fromkeys(GROUPS, turn_deg)
    none = np.zeros((0, 2)), np.ones(2), 0.1, 0.0, turn, {}, 0.0, 1
    inferred = Inferred(rig(**values), sigma, *none, 0.3, np.full(1, 0.02), np.zeros((0, 2, 0)))
    return SharedFound(inferred, names, told, 50.0, SLOT_US)


def decision(effect, **values) -> Decision:
    """Decide for an effect by hand."""
    return Decision(effect.name, True, "", answer=found(**values))


@dataclass(frozen=True)
class SharedWorld:
    """A world of three LEDs, with what effects of shared unknowns look at."""

    recording: Recording
    terms: Terms = Terms()
    aim: object = None
    lag: object = None
    metal: float | None = None
    leak: float = 0.0
    clock_us: float = 0.0
    thresholds: bool = False
    found: object = None
    memo: Memo = None
    distance_is_unknown: bool = False


def world(terms=Terms(), known=None, **more) -> SharedWorld:
    """Give such a world; `known` is what was found already."""
    schedule = Schedule(np.arange(N_LED, dtype=np.int32), SLOT_US, 1.0, 7.0)
    sensor = Sensor(2, 2, np.full((2, 2), 0.2, np.float32), 0.3, 50.0)
    recording = Recording(SimpleNamespace(), sensor, schedule, np.array([0, 3000]), "mine")
    memo = Memo()
    if known is not None:
        memo("shared", (FITTED,), lambda: known)
    return SharedWorld(recording, terms, memo=memo, **more)


FITTED = SimpleNamespace()  # a fit, of which the memo remembers what was found
