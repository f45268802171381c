"""Laws of the noise of thresholds."""

import mitsuba as mi
import numpy as np
import pytest
from scipy import integrate, special, stats

from evsdr.solve import law

Y = np.concatenate([np.linspace(-40, 8, 97), [-1000.0, -16.01, -15.99, -3.999, -2.001, -1.999, 0.0]])


def density(r):
    return (1 - law.SHARE) * stats.norm.pdf(r) + law.SHARE * stats.t.pdf(r, 3)


def test_density_of_times_balances_residuals_on_average(rng):
    z = rng.standard_normal(200_000)
    for width in (1.0, 2.0, 1e6):
        weight = 1 / (1 + (z / width) ** 2)
        assert law.gaussian_share(width) == pytest.approx(np.mean(z**2 * weight), abs=0.01)


def test_survival_is_the_integral_of_the_density():
    below = (1 - law.SHARE) * special.ndtr(Y) + law.SHARE * stats.t.cdf(Y, 3)
    assert integrate.quad(density, -np.inf, -1)[0] == pytest.approx(below[np.argmin(np.abs(Y + 1))])
    value, slope, bend = (v.numpy() for v in law.survival(mi.Float(Y)))
    np.testing.assert_allclose(value, -np.log(below), rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(slope, density(Y) / below, rtol=5e-3, atol=1e-6)
    assert (bend >= 0).all()
    near, step = np.linspace(-1.9, 4, 30), 1e-2
    ahead, behind = (law.survival(mi.Float(near + s))[1].numpy() for s in (step, -step))
    np.testing.assert_allclose(
        law.survival(mi.Float(near))[2].numpy(), (behind - ahead) / (2 * step), rtol=0.02, atol=2e-3
    )


def test_cauchy_grows_slowly():
    value, weight = (v.numpy() for v in law.cauchy(mi.Float(0.5 * Y**2), mi.Float(2.0)))
    np.testing.assert_allclose(value, 2 * np.log1p(Y**2 / 4), rtol=1e-5)
    np.testing.assert_allclose(weight, 1 / (1 + Y**2 / 4), rtol=1e-5)


@pytest.mark.parametrize("beside", [0.0, np.linspace(0, 0.02, 40_000)])
def test_variance_of_noise_without_tails(rng, beside):
    """By the median alone it comes out 1.6 times as large."""
    size = 1 if np.ndim(beside) else 5
    known = np.sqrt(beside) * rng.standard_normal((size, 40_000))
    even = np.sqrt(0.03) * rng.uniform(-1, 1, (size, 40_000)) + known
    gaussian = 0.1 * rng.standard_normal((size, 40_000)) + known
    np.testing.assert_allclose(law.variance_of(gaussian, 3.0, beside), 0.01, rtol=0.15)
    np.testing.assert_allclose(law.variance_of(even, 3.0, beside), 0.01, rtol=0.25)


def test_variance_does_not_hear_long_tails(rng):
    u = 0.1 * rng.standard_normal(100_000)
    u[::20] *= 20
    assert law.variance_of(u, 3.0) == pytest.approx(0.01, rel=0.2)
    assert law.variance_of(np.zeros(9), 3.0, 0.02, 1e-4) == pytest.approx(1e-4)
