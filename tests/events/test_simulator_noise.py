"""Noise of event pixels: of each event, fixed, of leak, of photons."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import draw_pattern, simulate_events
from tests.support.pixel_light import CUTOFF, log_light, ring, run


def test_event_noise():
    """Thresholds of 0.05, redrawn at each event with 10 %: their mean, spread and independence."""
    signal = np.full((2, 20, 20), 0.01)
    signal[1] = 1.0
    pixel = replace(EventPixel.ideal(0.05, 0.0), event_noise=0.1)
    schedule = ring([0, 1], 10_000.0)
    index, polarity, t_us = run(signal, 0.0, schedule, 1, pixel)
    second = np.flatnonzero((np.diff(index) == 0) & (np.diff(polarity) == 0)) + 1
    here = index[second]
    change = log_light(t_us[second], here, signal, 0.0, schedule)
    change -= log_light(t_us[second - 1], here, signal, 0.0, schedule)
    noise = np.abs(change) / 0.05 - 1
    for sign in (1, -1):
        part = noise[polarity[second] == sign]
        assert len(part) > 30_000
        assert abs(part.mean()) < 0.003
        assert part.std() == pytest.approx(0.1, rel=0.02)
        assert np.mean(np.abs(part) < 0.1) == pytest.approx(0.6827, abs=0.01)
        assert abs(np.corrcoef(part[1:], part[:-1])[0, 1]) < 0.02


def test_fixed_pattern():
    """Mean, spread and correlation as measured on an EVK4; white; never below 0.02."""
    fixed = draw_pattern(EventPixel(), 300, 400, 1)
    on, off = fixed.threshold_on, fixed.threshold_off
    assert on.dtype == off.dtype == np.float32
    assert on.mean() == pytest.approx(0.2525, abs=6e-4) and on.std() == pytest.approx(0.049, rel=0.01)
    assert off.mean() == pytest.approx(0.3795, abs=6e-4) and off.std() == pytest.approx(0.039, rel=0.01)
    assert np.corrcoef(on.ravel(), off.ravel())[0, 1] == pytest.approx(-0.21, abs=0.01)
    assert abs(np.corrcoef(on[:, 1:].ravel(), on[:, :-1].ravel())[0, 1]) < 0.01
    assert len(np.unique(fixed.state)) == on.size
    assert draw_pattern(EventPixel(spread_on=0.5), 50, 50, 1).threshold_on.min() == np.float32(0.02)


def test_leak_and_hot_pixels():
    """At rest a pixel fires ON every 1 / leak + refractory; hot ones at their own rate."""
    signal = np.full((1, 20, 30), 0.5)
    pixel = replace(EventPixel.ideal(0.25, 1000.0), leak_hz=20, hot_fraction=0.3, hot_hz=100, spread_on=0.05)
    index, polarity, t_us = run(signal, 0.0, ring([0], 995_000.0), 1, pixel)
    count = np.bincount(index, minlength=600)
    assert (polarity == 1).all()
    assert set(count) == {19, 90}
    assert np.mean(count == 90) == pytest.approx(0.3, abs=0.06)
    gap = np.diff(t_us)[np.diff(index) == 0]
    rate = np.where(np.repeat(count, np.maximum(count - 1, 0)) == 90, 100, 20)
    np.testing.assert_allclose(gap, 1e6 / rate + 1000.0, rtol=1e-9)


def test_shot_noise():
    """Noise of standard deviation 0.1 crosses thresholds of 0.25 as often as a twin's, in any light.

    Per time constant, that is: dim light is as noisy, only slower.
    """
    pixel = replace(EventPixel.ideal(0.25, 0.0), cutoff_hz=3000, photon_rate_per_us=CUTOFF / (2 * 0.1**2))
    n_pixel, n_tau = 1600, 200
    per_tau = []
    for light in (1.0, 0.1):
        tau = 1 / (CUTOFF * light)
        index, polarity, _ = run(np.full((1, 40, 40), light), 0.0, ring([0], n_tau * tau), 1, pixel)
        per_tau.append([np.sum(polarity == sign) / (n_pixel * n_tau) for sign in (1, -1)])

    rng = np.random.default_rng(0)
    noise = 0.1 * rng.standard_normal(n_pixel)
    reference, fired = noise.copy(), np.zeros(2)
    kept = np.exp(-0.5)
    for _ in range(2 * n_tau):
        noise = kept * noise + 0.1 * np.sqrt(1 - kept**2) * rng.standard_normal(n_pixel)
        while (np.abs(noise - reference) >= 0.25).any():
            for k, sign in enumerate((1, -1)):
                beyond = sign * (noise - reference) >= 0.25
                fired[k] += beyond.sum()
                reference[beyond] += sign * 0.25
    np.testing.assert_allclose(per_tau, np.tile(fired / (n_pixel * n_tau), (2, 1)), rtol=0.05)
    assert fired.min() > 10_000


def test_shot_noise_under_leak():
    """Leak events jitter by about the noise, 0.02, in one long slot too."""
    quiet = replace(EventPixel.ideal(0.25, 0.0), cutoff_hz=3000, leak_hz=100)
    for photon_rate_per_us, jitter in ((CUTOFF / (2 * 0.02**2), 0.016), (0.0, 0.0)):
        pixel = replace(quiet, photon_rate_per_us=photon_rate_per_us)
        index, _, t_us = run(np.ones((1, 5, 5)), 0.0, ring([0], 1e6), 1, pixel)
        gap = np.diff(t_us)[np.diff(index) == 0] * 100e-6 * 0.25  # in log intensity
        assert gap.mean() == pytest.approx(0.25, rel=1e-3)
        assert gap.std() == pytest.approx(jitter, abs=0.004)


@pytest.mark.parametrize("light", [1.0, 0.1])
def test_default_noise_fires_nothing_in_steady_light(light):
    """The default shot noise is 1/26 of the nominal threshold."""
    pixel = EventPixel(spread_on=0, spread_off=0, leak_hz=0, hot_fraction=0)
    assert len(simulate_events(np.full((1, 16, 16), light), 0.0, ring([0], 1e6), 1, pixel)[0]) == 0


def test_light_in_which_photoreceptors_are_too_fast_is_refused():
    signal = np.full((2, 1, 1), 1e9)
    with pytest.raises(
        InputError, match="light of an LED is up to 1e[+]09, in which photoreceptors are too fast"
    ):
        run(signal, 0.0, ring([0, 1], 10_000.0), 1, EventPixel())
