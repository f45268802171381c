"""Photoreceptors that lag and are noisy, as the events tell it.

In dim light an event comes late, and noise makes it early; the solver would take both for other light.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.shared import SharedEffect, SharedFound, plus_minus
from evsdr.events.photoreceptor import Photoreceptors
from evsdr.model.lambert import signals_of
from evsdr.records import Recording
from evsdr.solve.problem import Problem
from evsdr.solve.solution import Solution

if TYPE_CHECKING:
    from evsdr.effects.world import World


@dataclass(frozen=True)
class Lag:
    """What photoreceptors make of log I.

    Attributes
    ----------
    tau_us : float
        Time constant at I = 1 [us].
    dark : float
        Light that their dark current amounts to.
    noise : float
        Standard deviation of log I behind them.
    """

    tau_us: float
    dark: float = 0.0
    noise: float = 0.0


def photoreceptors(recording: Recording, problem: Problem, solution: Solution, lag: Lag) -> Photoreceptors:
    """Give the photoreceptors of a problem's pixels under the light of a fit."""
    schedule, sensor = recording.schedule, recording.sensor
    signal = signals_of(problem.model, solution.theta)
    led = np.where(schedule.order < 0, len(signal) - 1, schedule.order)
    light = (signal[led] + float(problem.illumination.constant_light[0])).T
    row_of = np.full(problem.grid.mask.size, -1, np.int32)
    row_of[problem.pixel] = np.arange(problem.n_pixel)
    return Photoreceptors(
        light,
        row_of,
        schedule.crossfade,
        tau=lag.tau_us / schedule.slot_us,
        dark=lag.dark,
        noise=lag.noise,
        refractory=sensor.refractory_us / schedule.slot_us,
    )


class PhotoreceptorLag(SharedEffect):
    """Events that come late in dim light, and early by noise."""

    name, group = "photoreceptor lag", "lag"
    untold = "the events show none"

    def doubt(self, found: SharedFound, limit_deg: float) -> str:
        """Say that events come early by noise that is not modelled."""
        if found.untold_deg <= limit_deg:
            return ""
        return (
            "events come early, as noise of photoreceptors makes them where light is slow, but do not tell its time constant, so "
            f"that normals may be {found.untold_deg:.2g} degrees off, which sigmas count, and reflectances, too; make slots shorter."
        )

    def say(self, found: SharedFound) -> str:
        """Give time constant and noise."""
        rig, dark = (
            found.inferred.rig,
            f"(I + {found.inferred.rig.dark:.2g})" if found.inferred.rig.dark else "I",
        )
        return (
            f"events are {plus_minus(found.us('tau'))} / {dark} late, with noise of {rig.noise:.2g} in log I"
        )

    def numbers(self, found: SharedFound) -> dict:
        """Give them in numbers."""
        tau, sigma = found.us("tau")
        rig = found.inferred.rig
        return {"tau_us": tau, "tau_sigma_us": sigma, "dark": rig.dark, "noise": rig.noise}

    def model(self, world: "World", decision: Decision) -> "World":
        """Pair events as such photoreceptors show them."""
        rig = decision.answer.inferred.rig
        return replace(world, lag=Lag(decision.answer.us("tau")[0], rig.dark, rig.noise))
