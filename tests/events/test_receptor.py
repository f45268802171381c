"""A lag in closed form against small steps of its equation, with and without a dark current."""

import numpy as np
import pytest

from evsdr.events.receptor import (
    N_COLUMN,
    follow,
    late_at,
    light_at,
    own_rate,
    phase_at,
    shown_at,
)
from tests.support.receptor_steps import CROSSFADES, N_SLOT, N_STEP, TAU, light_of, stepped


@pytest.fixture
def lights(rng):
    out = 0.05 + rng.random((5, N_SLOT)) ** 3
    out[0, 2:5] = 0.05  # dark slots
    out[1, 3] = out[1, 4]  # a slot of steady light
    return out


@pytest.mark.parametrize("dark", [0.0, 0.2])
@pytest.mark.parametrize("crossfade", CROSSFADES)
@pytest.mark.parametrize("tau", [TAU, 10 * TAU])
def test_a_lag_obeys_its_equation(lights, tau, crossfade, dark):
    nodes, largest = np.zeros((N_SLOT, N_COLUMN)), 0.0
    for light in lights:
        follow(light, tau, dark, crossfade, nodes)
        position, log_now, v = stepped(light, tau, dark, crossfade)
        for k in range(49, N_STEP, 50):
            if crossfade == 0 and k % 1500 == 1499:
                continue  # the very moment of a switch
            late = late_at(position[k], light, tau, dark, crossfade, nodes)
            assert late == pytest.approx(log_now[k] - v[k], abs=0.004)
            largest = max(largest, abs(late))
    assert largest > 0.1


def test_a_dark_current_makes_it_faster(lights):
    light, late = lights[0], []
    for dark in (0.0, 0.2):
        nodes = np.zeros((N_SLOT, N_COLUMN))
        follow(light, 10 * TAU, dark, 1.0, nodes)
        late.append(abs(late_at(1.9, light, 10 * TAU, dark, 1.0, nodes)))
    assert late[1] < 0.6 * late[0]


@pytest.mark.parametrize("crossfade", CROSSFADES)
def test_the_light_that_is_shown_was_there(lights, crossfade):
    """At slot and fade that are told the light was exp(v), and not long ago."""
    nodes, n = np.zeros((N_SLOT, N_COLUMN)), 0
    for light in lights:
        follow(light, TAU, 0.0, crossfade, nodes)
        for at in np.linspace(0.013, N_SLOT - 0.01, 150):
            late = late_at(at, light, TAU, 0.0, crossfade, nodes)
            slot, fade = shown_at(at, late, light, crossfade)
            shown = light[slot] + fade * (light[(slot + 1) % N_SLOT] - light[slot])
            now = light_of(at, light, crossfade)
            assert np.log(shown) == pytest.approx(np.log(now) - late, abs=0.004)
            assert 0 <= fade <= 1 and (int(at) - slot) % N_SLOT <= 4
            n += abs(late) > 0.01
    assert n > 100


def test_what_shows_the_light_of_now_shows_the_phase_of_now(lights):
    for at in (0.2, 3.5, 6.99):
        for crossfade in CROSSFADES:
            told = shown_at(at, 0.0, lights[2], crossfade)
            assert told == pytest.approx(phase_at(at, crossfade, N_SLOT), abs=1e-9)


def test_light_and_rate_at_a_position():
    light = np.array([1.0, 3.0, 2.0])
    assert phase_at(1.9, 0.2, 3) == pytest.approx((1, 0.5))
    assert phase_at(1.5, 0.2, 3) == (1, 0.0) and phase_at(1.9, 0.0, 3) == (1, 0.0)
    assert light_at(1.9, light, 0.2) == pytest.approx(2.5)
    assert light_at(2.95, light, 0.1) == pytest.approx(1.5)  # the first follows the last
    assert own_rate(1.9, light, 0.5, 0.25, 0.2) == pytest.approx(5.5)
