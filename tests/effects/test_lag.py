"""Events that come late in dim light: found, moved back, and left alone where there are none."""

from dataclasses import replace
from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.effects.lag import PhotoreceptorLag, find_lag, photoreceptors
from evsdr.effects.world import Terms
from evsdr.events.pairs import pair_events
from evsdr.events.pixel import EventPixel
from evsdr.events.record import record, ring_schedule
from evsdr.metrics import angular_error_deg
from evsdr.model.illumination import Illumination
from evsdr.solve.problem import make_problem
from tests.support import sphere as sphere_solver
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals
from tests.support.worlds import SmallWorld

C_W = 0.05
CUTOFF_HZ = 3000.0
TAU_US = 1e6 / (2 * np.pi * CUTOFF_HZ)
SPECTRUM = np.array([0.1, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.6])


def sphere(cutoff_hz, photon_rate_per_us=0.0, size=32):
    """A recorded sphere: recording, light, mask and true normals."""
    normal, mask = sphere_normals(size)
    direction = ring_directions()
    signal = lambert_signals(normal, np.broadcast_to(SPECTRUM, (size, size, 8)), direction)
    still = {"spread_on": 0, "spread_off": 0, "leak_hz": 0, "hot_fraction": 0}
    pixel = EventPixel(
        0.2, 0.2, event_noise=0.05, cutoff_hz=cutoff_hz, photon_rate_per_us=photon_rate_per_us, **still
    )
    recording = record(np.where(mask, signal, 0), C_W, pixel, ring_schedule(len(signal)), 6)
    vectors = [mi.Vector3f(*d) for d in direction.tolist()]
    light = Illumination(vectors, [mi.Float(1.0)] * 24, [j % 8 for j in range(24)], mi.Float(C_W))
    return recording, light, mask, normal[mask]


def solve(recording, light, mask, receptors=None):
    problem = make_problem(recording, pair_events(recording, mask, receptors), light, mask)
    return problem, sphere_solver.solve(problem)


def mean_error(solution, normal):
    found = np.column_stack([-solution.theta[:, :2], np.ones(len(normal))])
    return angular_error_deg(found, normal).mean()


@pytest.fixture(scope="module")
def late():
    recording, light, mask, normal = sphere(CUTOFF_HZ)
    return recording, light, mask, normal, *solve(recording, light, mask)


def test_a_lag_is_found_and_its_events_mended(late):
    recording, light, mask, normal, problem, solution = late
    lag = find_lag(recording, problem, solution, False)
    assert lag.tau_us == pytest.approx(TAU_US, rel=0.12) and 0 < lag.tau_sigma_us < 5
    assert lag.noise < 0.002
    _, mended = solve(recording, light, mask, photoreceptors(recording, problem, solution, lag))
    assert mean_error(mended, normal) < 0.65 * mean_error(solution, normal)
    assert mended.noise < solution.noise


def test_noise_of_the_photoreceptors_is_found_and_mended():
    """Noise of 0.014 makes events early, and leaves their references off by half as much."""
    recording, light, mask, normal = sphere(CUTOFF_HZ, photon_rate_per_us=50.0)
    problem, solution = solve(recording, light, mask)
    lag = find_lag(recording, problem, solution, False)
    assert 0.004 < lag.noise < 0.01
    late = photoreceptors(recording, problem, solution, replace(lag, noise=0.0))
    noisy = photoreceptors(recording, problem, solution, lag)
    without, mended = (solve(recording, light, mask, receptors)[1] for receptors in (late, noisy))
    assert mean_error(mended, normal) < 0.97 * mean_error(without, normal)
    assert str(lag).startswith("modelled: events are ") and "by noise early" in str(lag)


def test_no_lag_is_found_where_there_is_none():
    recording, light, mask, _ = sphere(0.0)
    problem, solution = solve(recording, light, mask)
    assert find_lag(recording, problem, solution, False) is None


def test_a_few_pixels_tell_no_lag(late):
    recording, light, _, _, _, _ = late
    mask = np.zeros((32, 32), bool)
    mask[14:16, 10:14] = True
    keep = mask[recording.events.y, recording.events.x]
    events = replace(recording.events, **{n: getattr(recording.events, n)[keep] for n in "xypt"})
    few = replace(recording, events=events)
    problem, solution = solve(few, light, mask)
    assert find_lag(few, problem, solution, False) is None


@pytest.mark.parametrize("limit_deg", [0.05, 50.0])
def test_a_lag_is_modelled_if_it_turns_normals_by_more_than_the_limit(late, limit_deg):
    recording, light, mask, normal, problem, solution = late
    world = SmallWorld(recording, terms=Terms(limit_deg=limit_deg))
    decision = PhotoreceptorLag().decide("auto", world, SimpleNamespace(problem=problem, solution=solution))
    assert decision.modelled == (limit_deg < 1) and set(decision.found) == {"tau_us", "tau_sigma_us", "noise"}
    receptors = photoreceptors(recording, problem, solution, decision.answer)
    mended = solve(recording, light, mask, receptors)[1]
    turned = angular_error_deg(*([[-p, -q, 1] for p, q in s.theta[:, :2]] for s in (solution, mended))).mean()
    assert 0.4 < decision.expected_deg / turned < 2.5  # of few events of few pixels
    assert decision.why.startswith(
        "modelled: events are " if decision.modelled else "not modelled: lag, left"
    )
    assert PhotoreceptorLag().model(world, decision).lag is decision.answer


@pytest.mark.parametrize(
    ("asked", "terms", "words"),
    [
        ("off", Terms(), "asked for by --lag off"),
        ("auto", Terms(thorough=False), "preset fast"),
        ("auto", Terms(solver="adam", thorough=False), "solver adam"),
    ],
)
def test_when_no_lag_is_looked_for(asked, terms, words):
    decision = PhotoreceptorLag().decide(asked, SmallWorld(None, terms=terms), None)
    assert not decision.modelled and decision.why.endswith(words)
