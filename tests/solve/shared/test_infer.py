"""What pixels share is found together with their maps, on small spheres whose rig is not as told."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.effects.shared import WITH_LAG
from evsdr.metrics import angular_error_deg
from evsdr.records import Recording, Schedule, Sensor
from evsdr.solve.shared import infer as search
from evsdr.solve.shared.infer import infer
from evsdr.solve.shared.pixels import turned as turned_light
from evsdr.solve.shared.posterior import Posterior, Start
from evsdr.solve.shared.rig import GROUPS, Told
from evsdr.solve.unknowns import to_normal
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals
from tests.support.shared_unknowns import MOST, Case, dark_events, power_errors
from tests.support.sphere import SPECTRUM, ring_light, sphere_recording

WRONG = dict(log_power=power_errors(), late_us=50, refractory=1.15, thresholds=1.15)
QUIET = {"event_noise": 0.02}


@pytest.fixture(scope="module")
def wrong():
    return Case.sphere(wrong=WRONG, cutoff_hz=3000.0, **QUIET)


def test_all_at_once_is_found(wrong):
    """LED powers 10 % off, events 50 us late, refractory period and thresholds told 15 % too high."""
    found = wrong.infer()
    slot_us = wrong.recording.schedule.slot_us
    off = found.rig.log_power - WRONG["log_power"]
    assert np.sqrt(np.mean(off**2)) < 0.005 < 0.05 < np.std(WRONG["log_power"])
    assert np.abs(off / found.sigma.log_power).max() < 4.5
    assert found.rig.shift * slot_us == pytest.approx(50, abs=8)
    assert found.rig.refractory * slot_us == pytest.approx(52, abs=8)
    assert np.exp(found.rig.log_threshold) == pytest.approx(1 / 1.15, rel=0.015)
    assert found.rig.tau * slot_us == pytest.approx(53.05, rel=0.06) and found.rig.noise < 0.003
    assert found.scatter == pytest.approx(0.02, rel=0.15)
    assert wrong.error(found.theta) < 0.15 * wrong.error()


def test_names_limit_what_moves(wrong):
    found = wrong.infer(("powers",))
    same = replace(found.rig, log_power=wrong.told.log_power)
    np.testing.assert_array_equal(same.vector, wrong.told.vector)
    assert np.any(found.rig.log_power) and not replace(found.sigma, log_power=np.zeros(24)).vector.any()
    assert found.turn_deg["powers"] > 0.5
    assert all(found.turn_deg[group] == 0 for group in GROUPS if group != "powers")
    assert found.wanted["shift"] > 5 and found.wanted.keys() == {"tau", "dark", "noise", "shift", "leak"}


def test_sigmas_hold_what_is_not_believed_of_powers(wrong, monkeypatch):
    """All of it, if they are never believed; powers themselves are as well known as before."""
    believed = wrong.infer(("powers",))
    monkeypatch.setattr(search, "VAGUE", 0.0)
    found = wrong.infer(("powers",))
    np.testing.assert_array_equal(found.sigma.vector, believed.sigma.vector)
    assert believed.doubted == () and found.doubted == ("powers",)
    assert found.normal_sigma_deg > 5 * believed.normal_sigma_deg
    assert found.normal_sigma_deg == pytest.approx(found.turn_deg["powers"], rel=0.5)


def test_powers_that_are_off_say_how_well_the_gain_of_a_band_is_told(wrong):
    """No event tells that: 10 % of a power are 6 % of the mean of three."""
    found, others = wrong.infer(("powers",)), wrong.infer(("shift",))
    each = np.std(WRONG["log_power"]) / np.sqrt(3)
    assert found.log_reflectance_sigma == pytest.approx(np.full(8, each), rel=0.3)
    assert others.log_reflectance_sigma.max() < 0.3 * each


def test_nothing_unknown_leaves_all_as_told(wrong):
    found = wrong.infer(())
    np.testing.assert_array_equal(found.rig.vector, wrong.told.vector)
    assert not any(found.turn_deg.values()) and np.isfinite(found.theta).all()


def test_a_turn_tells_what_an_error_costs(wrong):
    """Powers taken as told turn normals by about what they are said to."""
    found = wrong.infer()
    without = wrong.infer(tuple(name for name in MOST if name != "powers"))
    turned = angular_error_deg(*(to_normal(of.theta) for of in (found, without))).mean()
    assert 0.4 < found.turn_deg["powers"] / turned < 2.5


def test_a_prior_holds_what_is_told_well(wrong):
    """Powers that are told to a thousandth of a percent stay: far better than events tell them, which then teach no other tolerance."""
    held = wrong.infer(("powers",), Told(powers=1e-5)).rig
    free = wrong.infer(("powers",)).rig
    assert np.abs(held.log_power).max() < 0.2 * np.abs(free.log_power).max()


@pytest.mark.parametrize("seed", [0, 2])
def test_an_untouched_recording_leaves_everything_as_told(seed):
    """There is no lag, nor noise; without one all is as told.

    From the second, a search whose steps go on as if noise could be negative ends with a refractory period of 62 us.
    """
    case = Case.sphere(seed=seed, **QUIET)
    lagging, slot_us = case.infer(), case.recording.schedule.slot_us
    assert lagging.no_lag and lagging.rig.noise < 0.003
    found = case.infer(tuple(name for name in MOST if name not in WITH_LAG))
    assert np.abs(found.rig.log_power / found.sigma.log_power).max() < 4
    assert np.abs(found.rig.log_power).max() < 0.005
    assert found.rig.refractory * slot_us == pytest.approx(52, abs=5)
    assert np.abs(found.rig.log_threshold).max() < 0.02
    assert case.error(found.theta) < 1.15 * case.error()


def test_a_search_that_ends_at_a_bound_begins_again(monkeypatch):
    """And what is likelier is kept: here the second search, whose first found no refractory period."""
    case, begun, settle = Case.sphere(seed=0, **QUIET), [], search._settle

    def stuck(posterior, point, tolerance):
        begun.append(posterior.rig(point.free).refractory)
        if len(begun) > 1:
            return settle(posterior, point, tolerance)
        free = np.where(posterior.basis.owner == "refractory", 0, point.free)
        return posterior, posterior.at(point.theta, free), 0

    monkeypatch.setattr(search, "_settle", stuck)
    found, slot_us = case.infer(), case.recording.schedule.slot_us
    assert [slot_us * value for value in begun] == pytest.approx([52, 52])
    assert found.rig.refractory * slot_us == pytest.approx(52, abs=5)


def test_a_search_for_a_lag_that_is_none_ends_after_two_rounds(wrong, monkeypatch):
    """One round may have gone too far."""
    answers = iter([True, False, True, True])
    monkeypatch.setattr(Posterior, "lacks_lag", lambda *_: True)
    monkeypatch.setattr(search, "_no_lag", lambda *_: next(answers))
    monkeypatch.setattr(search, "SETTLED", 0.0)
    found = wrong.infer(("tau", "powers"))
    assert found.n_step == 4 * search.N_STEP and found.no_lag and not list(answers)


def test_a_search_that_no_step_helps_ends(wrong, monkeypatch):
    """However short steps become, all are refused."""
    monkeypatch.setattr(Posterior, "risen", lambda *_: 1.0)
    found = wrong.infer(("powers",))
    np.testing.assert_array_equal(found.rig.log_power, 0)
    assert found.n_step <= 4 * search.N_STEP


def test_a_search_in_vain_ends_early(wrong, monkeypatch):
    """Events and model contradict each other whatever pixels share; a scatter that falls is given time."""
    assert not wrong.infer(("powers",)).in_vain
    monkeypatch.setattr(search, "SETTLED", 0.0)
    monkeypatch.setattr(search, "MISFIT", 0.0)
    found = wrong.infer(("powers",))
    assert found.in_vain and found.n_step == search.IN_VAIN * search.N_STEP


def test_a_lag_is_found():
    cutoff_hz = 3000.0
    case = Case.sphere(cutoff_hz=cutoff_hz, **QUIET)
    found = case.infer()
    tau_us, sigma_us = (getattr(of, "tau") * 10_000 for of in (found.rig, found.sigma))
    assert tau_us == pytest.approx(1e6 / (2 * np.pi * cutoff_hz), abs=max(3 * sigma_us, 2))
    assert sigma_us < 2 and case.error(found.theta) < 0.7 * case.error()
    assert found.wanted["dark"] < 4
    assert found.turn_deg["lag"] > 0.1


@pytest.mark.parametrize("leak_hz", [0.0, 1.0])
def test_a_leak_is_found(leak_hz):
    case = Case.sphere(leak_hz=leak_hz, **QUIET)
    found = case.infer(("leak", "thresholds"))
    rise, sigma = (of.leak * 1e6 / case.recording.schedule.slot_us for of in (found.rig, found.sigma))
    assert rise == pytest.approx(0.2 * leak_hz, abs=4 * sigma) and sigma < 0.02


def test_unknown_thresholds_of_pixels_have_a_mean_and_a_spread():
    """Thresholds told 15 % too high, and 10 % apart from pixel to pixel."""
    flaws = {"spread_on": 0.02, "spread_off": 0.02}
    case = Case.sphere(wrong={"thresholds": 1.15}, thresholds=True, **QUIET, **flaws)
    found = case.infer()
    assert np.exp(found.rig.log_threshold) == pytest.approx(1 / 1.15, rel=0.03)
    assert found.spread == pytest.approx(0.1, rel=0.25)
    assert found.theta.shape == (len(case.row), 2 + 8 + 2)


def test_directions_are_found_up_to_turns_of_the_ring():
    """LEDs a degree off along the circle, every second one, told to two: a turn of all is not to be known."""
    case = Case.sphere(**QUIET)
    tilt = np.zeros((24, 2))
    tilt[::2, 0] = np.radians(1.0)
    model = replace(case.pixels.model, illumination=turned_light(case.pixels.light, -tilt))
    case.pixels = replace(case.pixels, model=model)
    found = case.infer(("directions",), Told(directions_deg=2.0))
    off, told = (part - part.mean(axis=0) for part in (found.rig.tilt, tilt))
    assert np.linalg.norm(off[:, 0] - told[:, 0]) < 0.5 * np.linalg.norm(told[:, 0])
    assert found.turn_deg["directions"] > 0


def test_powers_and_directions_end_where_the_truth_leads():
    """From maps of a fit that took all as told, some in wrong minima, as from those of the truth; sigma holds both."""
    recording, light, normal, mask = sphere_recording(24, **QUIET)
    tilt, log_power = np.random.default_rng(1).normal(0, np.radians(1.0), (24, 2)), power_errors(0.05)
    factors = np.exp(-log_power).tolist()
    light = replace(turned_light(light, -tilt), irradiance=[mi.Float(factor) for factor in factors])
    case, told = Case(recording, light, normal, mask), Told(directions_deg=1.0)
    names = ("powers", "thresholds", "refractory", "directions")
    found, n = case.infer(names, told), case.truth
    theta = np.column_stack([-n[:, :2] / n[:, 2:], np.tile(np.log(SPECTRUM), (len(n), 1))])
    start = Start(theta, replace(case.told, log_power=log_power, tilt=tilt), np.ones(2), 0.02)
    true = infer(case.pixels, start, case.told, told, names)
    for name in ("tilt", "log_power"):
        apart = (getattr(found.rig, name) - getattr(true.rig, name)) / getattr(found.sigma, name)
        assert np.abs(apart).max() < 0.5, name
    assert 0.5 < case.error(found.theta) / found.normal_sigma_deg < 1.6 and case.error(found.theta) > 0.2
    for name, truth in (("tilt", tilt), ("log_power", log_power)):
        off = (getattr(found.rig, name) - truth) / getattr(found.sigma, name)
        assert 0.5 < np.sqrt(np.mean(off**2)) < 1.6, name


@pytest.mark.parametrize("dark", [0.0, 0.3])
def test_a_dark_current_is_wanted_where_there_is_one(dark):
    size, tau_us = 14, 100.0
    normal, mask = sphere_normals(size)
    signal = lambert_signals(normal, np.broadcast_to(SPECTRUM, (size, size, 8)), ring_directions())
    schedule = Schedule(np.arange(24, dtype=np.int32), 2000.0, 1.0)
    events = dark_events(np.where(mask, signal, 0), schedule, 4, tau_us, dark, 0.2)
    starts = np.arange(5) * 48_000
    recording = Recording(events, Sensor(size, size, 0.2, 0.2, 0.0), schedule, starts)
    case = Case(recording, ring_light(), normal, mask)
    names = ("tau",)
    wanted = case.infer(names).wanted["dark"]
    assert wanted > 10 if dark else wanted < 4
    if dark:
        found = case.infer((*names, "dark"), Told(dark=1.0))
        assert found.rig.dark == pytest.approx(dark, rel=0.1)
        assert found.rig.tau * 2000 == pytest.approx(tau_us, rel=0.05)


def test_a_refractory_period_is_no_longer_than_the_shortest_interval():
    """Told far too long, with a wide tolerance: else pairs would be left out one by one, and the cost with them."""
    case = Case.sphere(wrong={"refractory": 8.0}, **QUIET)
    found = case.infer(("refractory",), Told(refractory_us=2000.0))
    assert found.rig.refractory <= case.pixels.shortest + 1e-9
    assert found.rig.refractory < case.told.refractory


def test_no_round_of_steps_ends_higher_than_it_began():
    """Of few events under LEDs that switch, from the truth: with losses counted to .5 rounds end up to 32 higher."""
    switching = Schedule(np.arange(24, dtype=np.int32), 30_000.0, 0.0)
    flaws = dict(event_noise=0.1, cutoff_hz=3000.0, photon_rate_per_us=100.0)
    grey = 0.05 * SPECTRUM
    case = Case.sphere(
        20, spectrum=grey, thresholds=True, schedule=switching, n_round=5, threshold=0.12, **flaws
    )
    true = replace(case.told, tau=53.05 / switching.slot_us, noise=0.01)
    slopes = -case.truth[:, :2] / case.truth[:, 2:]
    theta = np.hstack([slopes, np.tile(np.append(np.log(grey), [0, 0]), (len(slopes), 1))])
    posterior = search._posterior(case.pixels, Start(theta, true, np.full(2, 0.02), 0.1), true, Told(), MOST)
    point = posterior.at(theta, posterior.basis.vectors.T @ true.vector)
    posterior = replace(posterior, weigh=point.variance)
    point, damping, costs = posterior.again(point), search.Damping(np.full(len(theta), 1e-3)), []
    for _ in range(8):
        costs.append(search._cost(posterior, point))
        point, damping, *_ = search._descend(posterior, point, damping)
    assert costs[-1] < costs[0] - 100
    assert max(np.diff(costs)) < search.RISEN * len(theta)  # which a step may cost
