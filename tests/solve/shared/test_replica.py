"""The bias of a search, found in events simulated at what it found, and what is left once it is taken off."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.records import Schedule
from evsdr.solve.shared import infer as search
from evsdr.solve.shared.infer import corrected, less_sure, own_bias
from evsdr.solve.shared.pixels import Nearer
from evsdr.solve.shared.replica import replica
from evsdr.solve.shared.rig import Basis, Told
from evsdr.solve.unknowns import to_normal
from tests.support.shared_unknowns import MOST, Case

EVK4 = dict(event_noise=0.02, cutoff_hz=3000.0, photon_rate_per_us=100.0)
TRUE_US, TRUE_NOISE = {"tau": 53.05, "shift": 0.0, "refractory": 52.0}, 0.0097


@pytest.fixture(scope="module")
def case():
    schedule = Schedule(np.arange(24, dtype=np.int32), 2000.0, 1.0)
    return Case.sphere(size=24, schedule=schedule, **EVK4)


@pytest.fixture(scope="module")
def found(case):
    return case.infer()


@pytest.fixture(scope="module")
def off(case, found):
    return own_bias(found, case.pixels, case.recording, Told(), MOST)


def values(case, found):
    return {name: getattr(found.rig, name) * case.recording.schedule.slot_us for name in TRUE_US}


def test_a_replica_is_like_the_recording(case, found):
    """As many events a pixel, of the same pixels in the same rounds; the same seed gives the same."""
    given = case.pixels, case.recording, found.theta, found.rig, found.scatter, found.departs
    new, again, other = replica(*given), replica(*given), replica(*given, seed=1)
    assert len(new.events[0]) == len(case.pixels.events[0])
    assert new.n_event == pytest.approx(case.pixels.n_event, rel=0.03)
    each = [np.diff(p.events[0]) for p in (new, case.pixels)]
    assert np.corrcoef(each)[0, 1] > 0.8
    np.testing.assert_array_equal(new.events[1], again.events[1])
    assert new.n_event != other.n_event or (new.events[1] != other.events[1]).any()
    for name in ("gap", "inside", "ending"):
        which = {"gap": 2, "inside": 4, "ending": 5}[name]
        mine, theirs = (np.mean(p.events[which]) for p in (new, case.pixels))
        assert mine == pytest.approx(theirs, rel=0.1), name


def test_late_events_and_a_recording_without_triggers(case, found):
    """Rounds are counted by the last event; a shift makes all events late."""
    given = found.theta, found.rig, found.scatter, found.departs
    bare = replace(case.recording, round_start_us=np.array([0]))
    assert replica(case.pixels, bare, *given).n_event == replica(case.pixels, case.recording, *given).n_event
    late = replace(found.rig, shift=found.rig.shift + 0.05)
    at = [replica(case.pixels, case.recording, given[0], r, *given[2:]).events[1] for r in (late, found.rig)]
    assert np.median((at[0] - at[1] + 12) % 24 - 12) == pytest.approx(0.05, abs=1e-3)


def test_a_replica_has_noise_and_scatter_of_its_thresholds(case, found):
    """Without any, another seed gives the same events."""

    def same(scatter, noise):
        rig = replace(found.rig, noise=noise)
        given = case.pixels, case.recording, found.theta, rig, scatter, 0.0
        one, other = (replica(*given, seed=seed).events[1] for seed in (0, 1))
        return len(one) == len(other) and np.array_equal(one, other)

    assert same(0.0, 0.0) and not same(0.02, 0.0) and not same(0.0, 0.01)


def test_pixels_that_fire_no_event_tell_nothing(case, found):
    dark = found.theta.copy()
    dark[3, 2:] = -12
    new = replica(case.pixels, case.recording, dark, found.rig, found.scatter, found.departs)
    assert new.events[0][3] == new.events[0][4]
    dim = replace(found, theta=dark)
    assert np.isfinite(own_bias(dim, case.pixels, case.recording, Told(), MOST)).all()
    none = replace(found, theta=np.where(np.arange(dark.shape[1]) < 2, dark, -12))
    assert not own_bias(none, case.pixels, case.recording, Told(), MOST).any()


def test_what_would_take_long_is_left_out(case, found, monkeypatch):
    """In slots of an hour nothing is simulated."""
    slot = 3.6e9 / case.recording.schedule.slot_us
    slow = replace(found, rig=replace(found.rig, tau=found.rig.tau / slot))
    monkeypatch.setattr(search, "replica", lambda *_: pytest.fail("it was simulated"))
    assert not own_bias(slow, case.pixels, case.recording, Told(), MOST).any()


def test_what_is_left_is_nearer_to_the_truth(case, found, off):
    """Noise that is a quarter too low, times that are late by four sigmas; sigmas hold what is left."""
    mended = corrected(found, off, case.pixels, MOST)
    before, after = values(case, found), values(case, mended)
    sigma = {name: getattr(mended.sigma, name) * case.recording.schedule.slot_us for name in TRUE_US}
    assert TRUE_NOISE - found.rig.noise > 0.002
    assert abs(mended.rig.noise - TRUE_NOISE) < 0.7 * abs(found.rig.noise - TRUE_NOISE)
    assert 4 < before["shift"] and abs(after["shift"]) < 0.7 * before["shift"]
    for name, true in TRUE_US.items():
        assert abs(after[name] - true) < 2 * sigma[name], name


def test_maps_follow_and_leds_stay(case, found, off):
    mended, basis = corrected(found, off, case.pixels, MOST), Basis.of(MOST, case.pixels.light.band)
    np.testing.assert_array_equal(mended.rig.log_power, found.rig.log_power)
    moved = basis.vectors.T @ (mended.rig.vector - found.rig.vector)
    np.testing.assert_allclose(moved, -off, atol=1e-12)
    np.testing.assert_allclose(mended.theta, found.theta + found.response @ moved)
    grown = mended.sigma.vector**2 - found.sigma.vector**2
    np.testing.assert_allclose(grown, (0.5 * basis.vectors @ off) ** 2, atol=1e-12)
    same = corrected(found, 0 * off, case.pixels, MOST)
    np.testing.assert_array_equal(same.rig.vector, found.rig.vector)
    assert same.normal_sigma_deg == found.normal_sigma_deg


def test_what_shared_values_may_be_off_by_is_left_open_of_maps(case, found):
    """Normals by as much as they turn with it, reflectances by as much as they follow, of the median pixel."""
    basis = Basis.of(MOST, case.pixels.light.band)
    by = np.where(basis.owner == "shift", 1e-2, 0.0)
    unsure, moved = less_sure(found, by, basis), found.response @ by
    turned = np.sum(to_normal(found.theta) * to_normal(found.theta + moved), axis=1)
    angle = np.median(np.degrees(np.arccos(np.minimum(turned, 1))))
    grown = np.sqrt(unsure.normal_sigma_deg**2 - found.normal_sigma_deg**2)
    assert angle > 0.01 and grown == pytest.approx(angle, rel=0.05)
    grown = np.sqrt(unsure.log_reflectance_sigma**2 - found.log_reflectance_sigma**2)
    n_map = 2 + case.pixels.light.n_band
    np.testing.assert_allclose(grown, np.median(np.abs(moved[:, 2:n_map]), axis=0), rtol=1e-3)
    assert np.hypot(found.sigma.shift, 1e-2) == pytest.approx(unsure.sigma.shift)


def test_the_distance_of_a_surface_before_near_leds_is_corrected_too(case, found):
    """And powers stay as they were found."""
    n, far = len(case.row), case.pixels.light

    def light(by):
        wide = [
            type(d)(d.x + 0.1 * by * (j % 3) + dr.zeros(mi.Float, n), d.y, d.z)
            for j, d in enumerate(far.direction)
        ]
        return replace(
            far, direction=wide, irradiance=[e * (1 + by) + dr.zeros(mi.Float, n) for e in far.irradiance]
        )

    near = replace(case.pixels, nearer=Nearer(0.5, tuple(light(by) for by in (-0.5, 0, 0.5))))
    names = (*MOST, "distance")
    known = replace(found, sigma=replace(found.sigma, distance=0.1))
    off = own_bias(known, near, case.recording, Told(distance=0.25), names)
    owner = Basis.of(names, far.band).owner
    assert off[owner == "distance"].all() and not off[owner == "powers"].any()


def test_no_correction_makes_times_negative_or_longer_than_any_gap(case, found):
    basis = Basis.of(MOST, case.pixels.light.band)
    far = np.where(np.isin(basis.owner, ("tau", "noise", "refractory")), 1.0, 0.0)
    rig = corrected(found, far, case.pixels, MOST).rig
    assert rig.noise == 0 and rig.refractory == 0 and rig.tau == pytest.approx(case.pixels.quickest)
    longer = corrected(found, np.where(basis.owner == "refractory", -1.0, 0.0), case.pixels, MOST).rig
    assert longer.refractory == pytest.approx(case.pixels.shortest)
