"""What residuals of neighbours have in common, against noise and errors that are known."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.records import Signals
from evsdr.solve.discrepancy import common_share, excess_share, noise_of
from evsdr.solve.unknowns import weak_prior

SIZE, N_LED = 24, 16
MASK = np.hypot(*(np.indices((SIZE, SIZE)) - 11.5)) < 11


def residuals(common: np.ndarray, seed: int = 0) -> Signals:
    """Residuals (n, n_led) with noise of each pixel, and a part that neighbours have in common, relative to the noise."""
    rng = np.random.default_rng(seed)
    n = np.count_nonzero(MASK)
    sigma = rng.uniform(0.02, 0.1, (n, N_LED))
    pattern = rng.standard_normal(N_LED)
    pattern *= np.sqrt(N_LED / np.sum((pattern - pattern.mean()) ** 2))
    off = sigma * (rng.standard_normal((n, N_LED)) + common[MASK][:, None] * (pattern - pattern.mean()))
    ones = np.ones((n, N_LED))
    given = np.flatnonzero(MASK), ones, off, sigma, ones[:, 0], 50 * ones[:, 0]
    return Signals(*given, np.arange(N_LED) % 8, np.tile([0, 0, 1.0], (N_LED, 1)), 0.05)


def test_noise_of_single_pixels_is_not_shared():
    share, common = common_share(residuals(np.zeros(MASK.shape)), MASK, MASK)
    assert common < 0.01 and share.max() < 0.06


def test_what_neighbours_share_is_found_where_it_is():
    """The square of its size, relative to the noise of a pixel."""
    left = np.where(np.arange(SIZE) < SIZE // 2, 0.7, 0.0) * np.ones((SIZE, 1))
    share, common = common_share(residuals(left), MASK, MASK)
    image = np.zeros(MASK.shape)
    image[MASK] = share
    assert common == pytest.approx(0.25, rel=0.15)
    assert image[10:14, 3:7].mean() == pytest.approx(0.49, rel=0.2)
    assert image[10:14, 17:21].max() < 0.3 * image[10:14, 3:7].min()


def test_leds_of_which_no_event_tells_and_unknown_pixels_count_for_nothing():
    signals = residuals(np.full(MASK.shape, 0.7))
    odd = np.arange(N_LED) % 2 == 1
    half = replace(signals, sigma=np.where(odd, 1.0, signals.sigma), change=np.where(odd, 0, signals.change))
    without = replace(signals, sigma=signals.sigma[:, ~odd], change=signals.change[:, ~odd])
    assert common_share(half, MASK, MASK)[1] == pytest.approx(common_share(without, MASK, MASK)[1])
    share, common = common_share(signals, MASK, np.zeros_like(MASK))
    assert common == 0 and not share.any()


def test_pixels_that_were_not_asked_take_the_share_of_all():
    whole = residuals(np.full(MASK.shape, 0.7))
    some = slice(0, len(whole.pixel) // 2)
    names = "pixel", "modelled", "change", "sigma", "residual", "count"
    part = replace(whole, **{name: getattr(whole, name)[some] for name in names})
    share, common = common_share(part, MASK, MASK)
    assert len(share) == len(whole.pixel)
    assert share[-1] == pytest.approx(common)


def test_residuals_beyond_noise_count_where_they_are():
    """By as much as they are larger, in a single pixel; none where no pixel was asked."""
    odd = np.zeros(MASK.shape)
    odd[12, 12] = 2.0
    signals = residuals(odd)
    share, at = excess_share(signals, MASK), np.flatnonzero(MASK) == 12 * SIZE + 12
    assert share[at][0] == pytest.approx(4.0, rel=0.4)
    assert np.median(share[~at]) < 0.1
    small = replace(signals, change=0.7 * signals.change)  # as of noise that maps were fitted to
    assert np.mean(excess_share(small, MASK)[~at] > 0) < 0.05
    part = replace(signals, pixel=signals.pixel[:5], change=signals.change[:5], sigma=signals.sigma[:5])
    assert not excess_share(part, MASK)[5:].any()


def test_noise_does_nothing_where_only_priors_tell():
    """By least squares with the weak prior, and draws of the noise."""
    rng, prior = np.random.default_rng(1), weak_prior(2)[1]
    jacobian = rng.standard_normal((5, 4)) * [1, 1, 1, 0.01]  # events hardly tell of the second band
    own = np.linalg.inv(jacobian.T @ jacobian / 0.2**2 + prior)
    drawn = own @ jacobian.T / 0.2**2 @ (0.2 * rng.standard_normal((5, 100_000)))
    found = noise_of(own[None])[0]
    np.testing.assert_allclose(found, np.cov(drawn), rtol=0.05, atol=1e-4)
    assert found[3, 3] < 0.03 * own[3, 3]
