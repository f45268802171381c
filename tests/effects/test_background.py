"""Events that come by chance are counted, and left out where there are many; what comes again in each round is no chance."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from evsdr import Settings
from evsdr.effects.background import BackgroundActivity
from evsdr.events.phase import phase
from evsdr.fitting.decoder import Decoder, start_normals
from evsdr.metrics import angular_error_deg
from tests.support.foreign_recordings import ESIM, WATCHED, record
from tests.support.setups import fitted_alone, recorded, scene_of

SIZE, HZ = 24, 4.0


@cache
def watched(hz: float):
    """Watch the sphere by an ESIM that fires so many events of each polarity a second by chance."""
    pixel = ESIM._replace(event_noise=0.1, noise_on_hz=hz, noise_off_hz=hz)
    return record(WATCHED["esim"]._replace(pixel=pixel), size=SIZE)


@cache
def decided(hz: float):
    ring, recording, _ = watched(hz)
    world, fitted = fitted_alone(ring, recording, thresholds=True)
    return world, fitted, BackgroundActivity().decide("auto", world, fitted)


def test_events_by_chance_are_counted():
    _, recording, truth = watched(HZ)
    seconds = np.ptp(recording.round_start_us) * 1e-6
    share = 2 * HZ * seconds * np.count_nonzero(truth.mask) / len(recording.events.t)
    decision = decided(HZ)[2]
    assert decision.modelled and decision.found["share"] == pytest.approx(share, rel=0.25)
    assert "come by chance" in decision.why


def test_none_where_there_are_none():
    decision = decided(0.0)[2]
    assert not decision.modelled and decision.why == "none: 0.0% of a pixel's events come by chance"


def test_leaving_them_out_mends_thresholds_and_maps():
    truth, (world, fitted, decision) = watched(HZ)[2], decided(HZ)
    mended = BackgroundActivity().model(world, decision)
    problem = mended.problem()
    left_out = 1 - problem.pairs.counts.sum() / fitted.problem.pairs.counts.sum()
    assert 0.7 * decision.found["share"] < left_out < 1.1 * decision.found["share"]
    clean = decided(0.0)[1]
    again = fitted_alone_in(mended)
    known = truth.mask & fitted.maps.mask & clean.maps.mask & again.maps.mask
    before, after, best = (
        np.median(angular_error_deg(of.maps.normal, truth.normal)[known]) for of in (fitted, again, clean)
    )
    assert after - best < 0.7 * (before - best)
    off, still = (abs(np.median(of.solution.threshold_gain) - 1) for of in (fitted, again))
    assert still < 0.5 * off


def fitted_alone_in(world):
    """Fit as `fitted_alone` does, in a world."""
    return Decoder(world.ring, Settings(), start_normals(world.ring, "frontal"), True)(
        world.problem(), None, "rough"
    )


def test_what_comes_again_in_each_round_is_no_chance():
    recording, _ = recorded()
    events = recording.events
    slot = phase(events.t, recording.schedule, recording.round_start_us)[0].astype(int)
    wrong = np.isin(slot, (3, 9, 14, 20))
    spoilt = replace(
        recording, events=replace(events, p=np.where(wrong, 1 - events.p, events.p).astype(np.int8))
    )
    world, fitted = fitted_alone(scene_of(), spoilt)
    decision = BackgroundActivity().decide("auto", world, fitted)
    assert not decision.modelled and "comes again in the same slots" in decision.why
