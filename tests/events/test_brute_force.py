"""Simulated events against a brute-force integration of the same pixel: none is lost, and none comes at another time."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import draw_pattern, find_crossings
from tests.support.brute_pixel import draw_noise, fire, watch
from tests.support.pixel_light import CUTOFF, ring, run

ORDER, SLOT_US, VEIL = [0, 2, -1, 1, 3], 4000.0, 0.03
QUIET = replace(EventPixel(), event_noise=0.0, photon_rate_per_us=0.0, leak_hz=0.0, hot_fraction=0.0)
EVEN = replace(QUIET, spread_on=0.0, spread_off=0.0)


def signals(n_pixel):
    """From nearly dark to bright."""
    return np.random.default_rng(7).random((4, n_pixel)) ** 3


@pytest.mark.parametrize("crossfade", [1.0, 0.25, 0.0])
@pytest.mark.parametrize(
    "pixel, rise_us",
    [
        (replace(EVEN, cutoff_hz=0.0), 0.0),
        (EVEN, 0.0),
        (replace(QUIET, leak_hz=200.0), 0.0),
        (replace(EVEN, cutoff_hz=500.0, contrast_threshold_on=0.1, refractory_us=0.0), 0.0),
        (
            replace(EVEN, cutoff_hz=30_000.0, refractory_us=700.5, contrast_threshold_off=0.15, leak_hz=50.0),
            0.0,
        ),
        (replace(EVEN, leak_hz=20.0), 300.0),
    ],
    ids=["ideal", "lag", "leak and mismatch", "slow and low", "fast and long refractory period", "slow LEDs"],
)
def test_the_same_events(pixel, rise_us, crossfade):
    """Number, polarity and order of all events are the same; times are to a microsecond, or where light hardly changes
    to 5e-5 in log light."""
    signal = signals(14)
    fixed = draw_pattern(pixel, 1, 14, 3)
    schedule = ring(ORDER, SLOT_US, crossfade)
    found = find_crossings(signal[:, None], VEIL, schedule, 2, pixel, fixed, rise_us)
    seen = watch(signal, VEIL, ORDER, SLOT_US, crossfade, 2, pixel.cutoff_hz, rise_us)
    n_event, late = 0, []
    for i in range(14):
        on, off = fixed.threshold_on[0, i].astype(float), fixed.threshold_off[0, i].astype(float)
        path, leak = seen.log_light[:, i], 1e-6 * pixel.leak_hz * on
        t_us, polarity = fire(seen.t_us, path, on, off, pixel.refractory_us, leak)
        mine = found.pixel == i
        np.testing.assert_array_equal(found.polarity[mine], polarity)
        moved = np.interp(found.t_us[mine], seen.t_us, path) - np.interp(t_us, seen.t_us, path)
        off_us = np.abs(found.t_us[mine] - t_us)
        assert ((off_us < 1) | (np.abs(moved) < 5e-5)).all()
        late.extend(off_us)
        n_event += len(t_us)
    assert n_event > (60 if crossfade == 0 else 150)
    assert np.median(late) < 0.01


@pytest.mark.parametrize("noise, event_noise", [(0.01, 0.0), (0.03, 0.0), (0.01, 0.1), (0.06, 0.05)])
def test_the_same_statistics(noise, event_noise):
    """With noise the number of events and their intervals are the same in the mean, to 3.5 of its standard deviations,
    also where most of them are the noise's."""
    n_twin, light = 60, np.array([0.1, 0.5, 1.0])
    pixel = replace(EVEN, photon_rate_per_us=CUTOFF / (2 * noise**2), event_noise=event_noise)
    signal = light * np.array([0.3, 1, 0.15])[:, None]
    order, n_simulated = [0, 1, 2], 4 * n_twin
    rng, seen = np.random.default_rng(1), watch(signal, 0.0, order, 8000.0, 1.0, 1, 3000.0)
    index, polarity, t_us = run(
        np.repeat(signal, n_simulated, 1)[:, None], 0.0, ring(order, 8000.0), 1, pixel, seed=5
    )
    for i in range(3):
        twins = []
        for _ in range(n_twin):
            path = seen.log_light[:, i] + draw_noise(seen.own_time[:, i], noise, rng)
            twins.append(fire(seen.t_us, path, 0.2525, 0.3795, 52.0, 0.0, event_noise, rng))
        mine = [np.flatnonzero(index == j) for j in range(i * n_simulated, (i + 1) * n_simulated)]
        for number in (count_on, count_off, mean_interval, mean_time):
            theirs = np.array([number(t, p) for t, p in twins])
            ours = np.array([number(t_us[k], polarity[k]) for k in mine])
            sigma = np.hypot(theirs.std() / n_twin**0.5, ours.std() / n_simulated**0.5)
            assert abs(ours.mean() - theirs.mean()) <= 3.5 * sigma + 1e-9
            assert sigma < 0.05 * theirs.mean()


def count_on(t, p):
    return np.sum(p > 0)


def count_off(t, p):
    return np.sum(p < 0)


def mean_interval(t, p):
    return np.mean(np.diff(t))


def mean_time(t, p):
    return np.mean(t)
