"""Random numbers of a pixel: evenly drawn, and normal."""

import numpy as np
import pytest

from evsdr.events.draws import _draw_uniform, draw_normal
from tests.support.streams import draws


def test_splitmix64():
    """The first numbers of the published generator for seed 0 (Steele et al. 2014; Vigna's splitmix64.c)."""
    state = np.uint64(0)
    for expected in (0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F):
        state, u = _draw_uniform(state)
        state = np.uint64(state)
        assert u == ((expected >> 11) + 0.5) * 2.0**-53


def test_normal_deviates():
    z = draws(draw_normal, 200_000).ravel()
    assert z.mean() == pytest.approx(0, abs=0.008) and z.std() == pytest.approx(1, abs=0.006)
    for level, share in ((0.5, 0.38292), (1, 0.68269), (2, 0.95450), (3, 0.99730)):
        assert np.mean(np.abs(z) < level) == pytest.approx(
            share, abs=4 * np.sqrt(share * (1 - share) / len(z))
        )
    assert np.mean(np.abs(z) > 3.6541528853610088) == pytest.approx(2.58e-4, rel=0.5)  # the tail's own layer
    assert np.mean(z**4) == pytest.approx(3, abs=0.08)
    assert abs(np.corrcoef(z[1:], z[:-1])[0, 1]) < 0.01
