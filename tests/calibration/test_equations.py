"""What events tell of signals and of the sensor: unknowns come back from recordings, with those the pixels share."""

import numpy as np
import pytest

from evsdr.calibration.equations import fit_events
from evsdr.events.pixel import EventPixel
from tests.support.watched_pixels import LIGHT, MASK, TRUTH, unknown_signals, watched


def fit(part):
    return fit_events([part], unknown_signals, np.full(3, 1.0), np.full(3, np.inf))


def test_signals_come_back_within_their_sigma():
    off = []
    for seed in range(5):
        found = fit(watched(seed=seed))
        assert found.converged and found.sensor["tau"] == 0 and found.sensor_sigma["tau"] == 0
        off.append((found.x - TRUTH) / np.sqrt(np.diagonal(found.covariance)))
    assert np.abs(off).max() < 4.5 and np.abs(np.mean(off)) < 1
    assert 1e-4 < np.sqrt(np.diagonal(found.covariance)).max() < 2e-3
    assert found.noise == pytest.approx(0.02, rel=0.3)
    assert len(found.residual) == len(found.part) == len(found.pixel) and not found.part.any()
    assert set(found.pixel) == set(range(MASK.size)) and np.median(np.abs(found.residual)) < 0.03


def test_an_evk4_is_found_with_the_signals():
    """Lag and noise in dim light; powers were off by many sigma as long as only a first order of the lag was known."""
    pixel = EventPixel()
    found = fit(watched(pixel))
    assert found.converged and np.isfinite(found.residual).all()
    assert found.sensor["tau"] * LIGHT == pytest.approx(1e6 / (2 * np.pi * pixel.cutoff_hz), rel=0.08)
    assert found.sensor["noise"] == pytest.approx(0.01, rel=0.25)
    sigma = np.sqrt(np.diagonal(found.covariance))
    assert np.abs((found.x - TRUTH) / sigma).max() < 3 and sigma.max() < 0.05
    assert found.sensor["dark"] == 0


@pytest.mark.parametrize("one_value", [False, True])
def test_thresholds_told_wrong_are_found(one_value):
    """Ten percent too high; told as one value, each pixel's own are unknown, too."""
    pixel = EventPixel(0.1, 0.15, event_noise=0.02, spread_on=0.015, spread_off=0.015, cutoff_hz=0.0,
                       photon_rate_per_us=0.0, leak_hz=0.0, hot_fraction=0.0)  # fmt: skip
    found = fit(watched(pixel, factor=1.1, one_value=one_value))
    for side in ("on", "off"):
        sigma = found.sensor_sigma[side]
        assert (
            found.sensor[side] == pytest.approx(-np.log(1.1), abs=max(4 * sigma, 0.02)) and 0 < sigma < 0.05
        )
    np.testing.assert_allclose(found.x, TRUTH, atol=0.01)
    assert found.noise == pytest.approx(0.02, rel=0.3)


def test_what_is_known_before_holds_back():
    def off_truth(x):
        return unknown_signals(x + TRUTH)

    part = watched()
    free, held = (
        fit_events([part], off_truth, np.zeros(3), np.array([s, np.inf, np.inf])) for s in (np.inf, 1e-6)
    )
    sigma = np.sqrt(free.covariance[0, 0]), np.sqrt(held.covariance[0, 0])
    assert sigma[1] < 2e-6 < sigma[0]
    assert abs(held.x[0]) < 3e-6 < abs(free.x[0])


def test_two_recordings_tell_more_than_one():
    one, two = watched(), watched(seed=1)
    single, both = (
        fit_events(p, unknown_signals, np.full(3, 1.0), np.full(3, np.inf)) for p in ([one], [one, two])
    )
    assert set(both.part) == {0, 1}
    assert np.diagonal(both.covariance).max() < 0.8 * np.diagonal(single.covariance).max()


@pytest.mark.parametrize("late_us", [0, 80])
def test_times_are_taken_over_where_they_are_clearly_not_as_told(late_us):
    """What the model of the noise tells wrong, 10 us, is no reason to move all times."""
    part = watched(EventPixel(), late_us=late_us)
    found = fit(part)
    assert found.sensor["shift"] == pytest.approx(late_us, abs=30 if late_us else 0)
    assert found.sensor_sigma["shift"] >= 10
    assert np.abs((found.x - TRUTH) / np.sqrt(np.diagonal(found.covariance))).max() < 3
