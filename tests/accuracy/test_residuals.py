"""Residuals at the truth are noise, whenever an event comes."""

import itertools

import numpy as np

import evsdr
from evsdr.events.lead import TABLE
from evsdr.fitting.simulation import render
from evsdr.solve.law import gaussian_share
from evsdr.solve.shared.kernel import Terms, pixel_sums
from evsdr.solve.shared.pixels import events_of

ROBUST, SHARE = 3.0, gaussian_share(3.0)


def test_under_leds_that_switch_residuals_at_the_truth_are_noise():
    """Whenever an event comes after a step: noise that lets it come early is told by how long it has tried."""
    scene, slot_us, noise = evsdr.load_scene("scenes/sphere.xml", size=28), 20_000.0, 0.0097
    pixel = evsdr.EventPixel(spread_on=0, spread_off=0, hot_fraction=0)
    tau = 1e6 / (2 * np.pi * pixel.cutoff_hz) / slot_us
    schedule = evsdr.Schedule(np.arange(24, dtype=np.int32), slot_us, 0.0)
    recording, truth = evsdr.simulate(scene, pixel, schedule, 6, seed=2, thresholds="calibrated")
    events = recording.events
    fired = np.bincount(events.y.astype(int) * 28 + events.x, minlength=28**2)
    some = np.flatnonzero((fired > 20) & truth.mask.ravel())
    signals = np.zeros((len(some), 4, 24))
    signals[:, 0] = render(scene)[0].reshape(24, -1).T[some]
    veil, thresholds = (
        float(scene.constant_light),
        (pixel.contrast_threshold_on, pixel.contrast_threshold_off),
    )
    times = tau, 0.0, noise, 0.0, pixel.refractory_us / slot_us, 0.1 * thresholds[0] * 1e-6 * slot_us, 0.0
    heard = events_of(recording, some)
    _, _, _, u, _ = pixel_sums(
        heard,
        schedule.order.astype(np.int64),
        np.array(scene.leds.band),
        veil,
        signals,
        np.zeros((len(some), 24, 0)),
        np.tile(thresholds, (len(some), 1)),
        False,
        np.tile(times, (5, 1)),
        Terms(0.0, pixel.event_noise, ROBUST, SHARE),
        TABLE,
        np.zeros(len(heard[1])),
    )
    offset, at, _, polarity, *_ = heard
    slot, row = at.astype(int) % 24, np.repeat(np.arange(len(some)), np.diff(offset))
    own = (at % 1) * (signals[row, 0, slot] + veil) / tau
    off = u * np.where(polarity > 0, *thresholds) / noise
    for first, last in itertools.pairwise((0, 0.3, 1, 2, 3, 4, 6, 9, 15, 30, 100)):
        here = off[np.isfinite(off) & (own >= first) & (own < last)]
        assert len(here) > 150
        assert abs(here.mean()) < 0.1 + 3 * here.std() / np.sqrt(len(here)), (first, last)
