"""Equations of event pairs: what a pair holds, and that unknowns come back from signals."""

import numpy as np
import pytest

from evsdr.calibration import equations
from evsdr.calibration.equations import collect_pairs, fit_pairs, join_pairs, sample_pairs
from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.events.record import record, ring_schedule

LIGHT = 0.1
SIGNAL = np.array([0.9, 0.2, 0.6])
MASK = np.ones((10, 12), bool)
PIXEL = EventPixel(0.1, 0.15, event_noise=0.02).idealised()


def recorded(signal=SIGNAL, crossfade=1.0, pixel=PIXEL, seed=0):
    images = np.broadcast_to(np.reshape(signal, (-1, 1, 1)), (len(signal), *MASK.shape))
    schedule = ring_schedule(
        len(signal), (0, -1, 1, 2), crossfade=crossfade
    )  # dark once, or one ratio is missing
    return record(images, LIGHT, pixel, schedule, 3, seed)


@pytest.fixture(scope="module")
def pairs():
    return collect_pairs(recorded(), MASK, np.zeros(MASK.shape, int))


def log_light(pairs, end):
    """log I of ends (or starts) of pairs, in plain NumPy."""
    columns = slice(0, 2) if end else slice(2, 4)
    signal = np.append(SIGNAL, 0)[pairs.led[:, columns]]
    return np.log(LIGHT + np.sum(pairs.share[:, columns] * signal, axis=1))


def test_a_pair_tells_the_change_of_log_light(pairs):
    change = log_light(pairs, True) - log_light(pairs, False)
    error = (change - pairs.change) / np.abs(pairs.change)
    assert np.abs(np.median(error)) < 0.005 and 0.01 < np.std(error) < 0.03
    assert set(np.unique(pairs.change)) == {-0.15, 0.1}
    np.testing.assert_allclose(pairs.share.reshape(-1, 2, 2).sum(axis=2), 1)
    assert set(pairs.cluster) == set(range(MASK.size))


def test_rates_are_those_of_the_shares(pairs):
    """A slot of 20 ms that fades all the while: 1/20 per ms, out and in."""
    np.testing.assert_allclose(np.abs(pairs.rate[pairs.rate != 0]), 1 / 20)
    np.testing.assert_allclose(pairs.rate.reshape(-1, 2, 2).sum(axis=2), 0, atol=1e-12)


def test_hard_switches_tell_no_exact_change():
    with pytest.raises(InputError, match="crossfade is 0, .* after a hard switch"):
        collect_pairs(recorded(crossfade=0.0), MASK, np.zeros(MASK.shape, int))


def test_pixels_of_two_recordings_stay_apart(pairs):
    both = join_pairs([pairs, pairs])
    n = len(pairs.change)
    assert len(both.change) == 2 * n
    assert not set(both.cluster[:n]) & set(both.cluster[n:])
    np.testing.assert_array_equal(both.led[n:], pairs.led)


def test_pairs_are_thinned_evenly_and_alike(pairs, monkeypatch):
    monkeypatch.setattr(equations, "MOST_PAIRS", len(pairs.change))
    assert sample_pairs(pairs, 0) is pairs
    monkeypatch.setattr(equations, "MOST_PAIRS", 200)
    few, again, other = sample_pairs(pairs, 0), sample_pairs(pairs, 0), sample_pairs(pairs, 1)
    assert len(few.change) == 200
    np.testing.assert_array_equal(few.led, again.led)
    assert not np.array_equal(few.cluster, other.cluster)
    assert np.count_nonzero(np.bincount(few.cluster)) > 0.7 * MASK.size


def unknown_signals(x):
    """Signals in units of the constant light: one unknown per LED, its logarithm."""
    signal = np.exp(x)[:, None]
    return signal, signal[..., None], np.zeros((len(x), 1, 0))


def test_signals_come_back_within_their_sigma(pairs):
    """Without bias; the spread of 30 recordings is 1.4 sigma, as all pixels see the same."""
    truth = np.log(SIGNAL / LIGHT)
    off = []
    for seed in range(6):
        some = pairs if seed == 0 else collect_pairs(recorded(seed=seed), MASK, np.zeros(MASK.shape, int))
        found = fit_pairs(some, unknown_signals, np.full(3, 1.0), np.full(3, np.inf))
        assert found.converged
        off.append((found.x - truth) / np.sqrt(np.diagonal(found.covariance)))
    assert np.abs(off).max() < 4.5 and np.abs(np.mean(off)) < 1
    assert 1e-4 < np.sqrt(np.diagonal(found.covariance)).max() < 1e-3
    assert found.noise == pytest.approx(0.02, rel=0.3)


def test_what_is_known_before_holds_back(pairs):
    def off_truth(x):
        return unknown_signals(x + np.log(SIGNAL / LIGHT))

    free, held = (
        fit_pairs(pairs, off_truth, np.zeros(3), np.array([s, np.inf, np.inf])) for s in (np.inf, 1e-5)
    )
    sigma = np.sqrt(free.covariance[0, 0]), np.sqrt(held.covariance[0, 0])
    assert sigma[1] < 2e-5 < sigma[0]
    assert abs(held.x[0]) < 3e-5 < abs(free.x[0])
