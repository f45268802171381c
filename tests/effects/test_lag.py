"""Photoreceptors that lag: what is said of them, and that their pixels see a fit's light."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.effects.lag import Lag, PhotoreceptorLag, photoreceptors
from evsdr.events.pairs import pair_events
from evsdr.model.lambert import signals_of
from evsdr.solve.problem import make_problem
from tests.support.shared_worlds import decision, found, world
from tests.support.sphere import C_W, errors, solve, sphere_recording

CUTOFF_HZ = 3000.0
LAG = Lag(1e6 / (2 * np.pi * CUTOFF_HZ))


@pytest.fixture(scope="module")
def late():
    recording, light, normal, mask = sphere_recording(20, event_noise=0.05, cutoff_hz=CUTOFF_HZ)
    problem = make_problem(recording, pair_events(recording, mask), light, mask)
    return recording, light, mask, normal[mask], problem, solve(problem)


def test_a_lag_in_words_and_numbers():
    assert PhotoreceptorLag().say(found(tau=0.05, noise=0.01)) == (
        "events are 50 +- 10 us / I late, with noise of 0.01 in log I"
    )
    shared = found(tau=0.05, dark=0.02, noise=0.01)
    assert "50 +- 10 us / (I + 0.02) late" in PhotoreceptorLag().say(shared)
    numbers = PhotoreceptorLag().numbers(shared)
    assert numbers == pytest.approx({"tau_us": 50, "tau_sigma_us": 10, "dark": 0.02, "noise": 0.01})


def test_noise_that_events_want_but_do_not_tell_is_a_doubt():
    assert PhotoreceptorLag().doubt(found(), 0.05) == ""
    assert "0.3 degrees off" in PhotoreceptorLag().doubt(replace(found(), untold_deg=0.3), 0.05)


def test_a_lag_found_is_the_worlds():
    values = {"tau": 0.05, "dark": 0.02, "noise": 0.01}
    lag = PhotoreceptorLag().model(world(), decision(PhotoreceptorLag(), **values)).lag
    assert (lag.tau_us, lag.dark, lag.noise) == pytest.approx((50, 0.02, 0.01))


def test_photoreceptors_see_the_light_of_the_fit(late):
    recording, _, mask, _, problem, solution = late
    receptors = photoreceptors(recording, problem, solution, Lag(50.0, 0.02, 0.01))
    expected = signals_of(problem.model, solution.theta)[:24].T + C_W
    np.testing.assert_allclose(receptors.light, expected, rtol=1e-6)
    np.testing.assert_array_equal(receptors.row_of.reshape(mask.shape)[mask], np.arange(mask.sum()))
    assert (receptors.row_of.reshape(mask.shape)[~mask] == -1).all()
    told = receptors.tau, receptors.dark, receptors.noise, receptors.refractory
    assert told == pytest.approx((0.005, 0.02, 0.01, 0.0052))


def test_late_events_are_mended(late):
    recording, light, mask, normal, problem, solution = late
    receptors = photoreceptors(recording, problem, solution, LAG)
    mended = solve(make_problem(recording, pair_events(recording, mask, receptors), light, mask))
    before, after = (errors(s, normal)[0].mean() for s in (solution, mended))
    assert after < 0.7 * before and mended.noise < solution.noise
