"""What the cost depends on, as a state has it."""

import mitsuba as mi
import numpy as np

from evsdr.model.lambert import LambertianRing
from evsdr.solve.loop import data_of, start_of
from evsdr.solve.loss import Loss
from evsdr.solve.system import system_of
from evsdr.solve.unknowns import first_theta
from tests.support.sphere import sphere_problem


def test_noise_is_that_of_the_state_unless_told():
    problem, _ = sphere_problem(8, event_noise=0.1)
    light = problem.illumination
    data = data_of(LambertianRing(light), problem.pairs, light.constant_light, problem.grid, 2.0)
    frontal = np.tile([0.0, 0.0, 1.0], (problem.n_pixel, 1))
    state = start_of(data, first_theta(frontal, light.n_band, True, mi.Float), 4)
    system = system_of(data, state, Loss(2.0))
    assert float(system.noise[0]) == state.noise
    assert system.pairs is state.pairs and system.unknowns.thresholds and system.spread is state.spread
    each = mi.Float(np.linspace(0.1, 0.2, problem.n_pixel))
    assert system_of(data, state, Loss(2.0), each).noise is each
